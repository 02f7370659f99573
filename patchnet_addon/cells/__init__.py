# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of a level: the Morton keys that name them, and which of them fit a pixel."""
