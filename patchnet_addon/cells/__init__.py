# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of a level: their Morton keys, and the level-of-detail contract with pixels."""
