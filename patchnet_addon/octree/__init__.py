# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree builder: triangles to voxels to the sparse voxel octree, and its file."""
