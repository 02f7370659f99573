# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of boxes and squares, their batches and pieces, shades, octrees, and the voxelizer's sums of leaves."""

import numpy as np

from patchnet.patchnet_addon.octree.accumulate import LeafSums, SurfaceSums
from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import PLAIN_LEAVES, ClippedSurface, clip_batch, voxelize
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments, Shading, TriangleBatch
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals

QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # z is the last bit


def box(low, high, inwards=False):
    """Triangles (12, 3, 3) of a box whose faces look outwards, or inwards; the last two are its top."""
    sides = np.array([low, high], float)
    corners = np.array([[sides[k >> 2, 0], sides[k >> 1 & 1, 1], sides[k & 1, 2]] for k in range(8)])
    quads = [quad[::-1] if inwards else quad for quad in QUADS]
    return np.array([corners[[quad[0], *pair]] for quad in quads for pair in (quad[1:3], quad[2:4])])


def square(height, low=0.1, high=0.9):
    """Two triangles (2, 3, 3) of a square that faces up."""
    a, b, c, d = ((x, y, height) for x, y in ((low, low), (high, low), (high, high), (low, high)))
    return np.array([(a, b, c), (a, c, d)], float)


def pieces_of(batch, grid):
    """Pieces of a batch of triangles in the cells of a grid."""
    areas, _ = triangle_areas_and_normals(batch.corners_world)
    parts = list(clip_batch(batch, grid, areas, grid.depth))
    names = ("keys", "triangle", "barycentric", "area_world", "cut_keys")
    joined = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return Fragments(*joined, corners_voxel=parts[0].corners_voxel)


def even(luminance=0.5, opacity=1.0):
    """Shade of one luminance and opacity for all triangles, or of those of each (T,)."""

    def shade(batch, fragments):
        number = batch.first_triangle + fragments.triangle
        values = (np.asarray(of, np.float32) for of in (luminance, opacity))
        return Shading(*(of[number] if of.ndim else np.full(len(number), of) for of in values))

    return shade


def octree_of(source, shade, grid, **settings):
    """Octree of a surface in a grid, or, where `grid` is a depth, in one around it; settings of `build_octree`."""
    grid = Grid.around(source.bounds_world, grid) if isinstance(grid, int) else grid
    return drain(build_octree(source, grid, shade, **settings))


def leaves_of(source, grid, shade, layout=None, detail=PLAIN_LEAVES, **settings):
    """Leaf sums of each level with leaves, coarse first, all passes together; settings of `ClippedSurface`."""
    clipped = ClippedSurface(source, grid, layout, **settings)
    passes = drain(voxelize(clipped, shade, lambda leaves, _block_level: leaves, detail=detail))
    parts = [part for leaves in passes for part in leaves]
    return [_joined(level, parts) for level in sorted({part.level for part in parts})]


def in_batches(corners, cuts, uvs=None, materials=None):
    """Batches of triangles (T, 3, 3) that are cut at the numbers `cuts`."""
    uvs = np.zeros((len(corners), 3, 2), np.float32) if uvs is None else uvs
    materials = np.zeros(len(corners), np.int32) if materials is None else materials
    ranges = zip([0, *cuts], [*cuts, len(corners)], strict=True)
    return tuple(TriangleBatch(corners[a:b], uvs[a:b], materials[a:b], int(a)) for a, b in ranges)


def _joined(level, parts):
    chosen = [part for part in parts if part.level == level]
    sums = SurfaceSums(*(np.concatenate(column) for column in zip(*(part.sums for part in chosen), strict=True)))
    return LeafSums(level, np.concatenate([part.keys for part in chosen]), sums)
