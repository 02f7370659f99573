# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of a level's grid, and the Morton keys that name them."""
