# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour maps, heatmaps and image files."""
