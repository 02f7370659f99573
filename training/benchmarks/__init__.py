# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements of PatchNet and other programs, in the same process on the same input."""
