# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of boxes, pieces of triangles, and a shade of one luminance."""

import numpy as np

from patchnet.patchnet_addon.octree.voxelize import clip_batch, triangle_areas_and_normals
from patchnet.patchnet_addon.surface.mesh import Fragments

QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # z is the last bit


def box(low, high, inwards=False):
    """Triangles (12, 3, 3) of a box whose faces look outwards, or inwards; the last two are its top."""
    sides = np.array([low, high], float)
    corners = np.array([[sides[k >> 2, 0], sides[k >> 1 & 1, 1], sides[k & 1, 2]] for k in range(8)])
    quads = [quad[::-1] if inwards else quad for quad in QUADS]
    return np.array([corners[[quad[0], *pair]] for quad in quads for pair in (quad[1:3], quad[2:4])])


def pieces_of(batch, grid):
    """Pieces of a batch of triangles in the cells of a grid."""
    areas, _ = triangle_areas_and_normals(batch.corners_world)
    parts = list(clip_batch(batch, grid, areas, grid.depth))
    names = ("keys", "triangle", "barycentric", "area_world", "cut_keys")
    joined = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return Fragments(*joined, corners_voxel=parts[0].corners_voxel)


def even(luminance=0.5):
    """Shade of one luminance, opaque."""

    def shade(_batch, fragments):
        return np.full(len(fragments), luminance, np.float32), np.ones(len(fragments), np.float32)

    return shade
