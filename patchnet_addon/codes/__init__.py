# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches of fine voxels, the codes of all corners, the coded octree."""
