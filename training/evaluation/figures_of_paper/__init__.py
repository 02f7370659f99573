# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures 2 and 4 of the paper, with other scenes."""
