# SPDX-License-Identifier: GPL-3.0-or-later
"""Scales of the whole numbers that nodes of an octree store."""

LUMINANCE_SCALE = 65535.0  # luminance 1
NORMAL_SCALE = 127.0  # component 1 of a mean normal
