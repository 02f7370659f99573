# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles to voxels to the sparse voxel octree, and its file."""
