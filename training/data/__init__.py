# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples and octrees to learn from, and the batches that are gathered of them."""
