# SPDX-License-Identifier: GPL-3.0-or-later
"""Texel sizes by the leaf sizes of an octree, triangle by triangle."""

from __future__ import annotations

import numpy as np

from ..cells.morton import morton_encode
from ..octree.grid import Grid
from ..octree.leaf_levels import LeafLevels
from ..surface.mesh import MeshSource

_MAX_PARTS = 16  # parts of an edge that crosses many blocks


def texel_sizes(source: MeshSource, grid: Grid, layout: LeafLevels | None, texel_voxels: float) -> float | np.ndarray:
    """Sides (T,) float32, world units, of texels that are `texel_voxels` leaves wide; one for all without `layout`.

    A triangle across leaves of several sizes has as many texels as its parts would have: by the mean of their inverse
    areas, over points at most a block apart, or _MAX_PARTS^2 of them.
    """
    if layout is None:
        return grid.voxel_size_world * texel_voxels
    sides = np.empty(source.triangle_count, np.float32)
    block_world = grid.side_world / (1 << layout.block_level)
    for batch in source.batches():
        corners = batch.corners_world
        edges = np.roll(corners, -1, axis=1) - corners
        longest = np.sqrt((edges * edges).sum(axis=-1).max(axis=-1))
        parts = np.clip(np.ceil(longest / block_world), 1, _MAX_PARTS).astype(np.int64)
        result = sides[batch.first_triangle : batch.first_triangle + len(batch)]
        for number in np.unique(parts):
            chosen = np.flatnonzero(parts == number)
            points = np.einsum("pc,tcx->tpx", _centres(int(number)), corners[chosen])
            leaf = _leaf_sides(points.reshape(-1, 3), grid, layout).reshape(points.shape[:2])
            result[chosen] = texel_voxels / np.sqrt((1.0 / leaf**2).mean(axis=1))
    return sides


def _centres(parts: int) -> np.ndarray:
    """Barycentric centres (parts^2, 3) of the equal triangles of a subdivision with `parts` per edge."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(parts), np.arange(parts)))
    upright = i + j < parts
    upside_down = i + j < parts - 1
    first = np.concatenate([i[upright] + 1 / 3, i[upside_down] + 2 / 3]) / parts
    second = np.concatenate([j[upright] + 1 / 3, j[upside_down] + 2 / 3]) / parts
    return np.stack([1.0 - first - second, first, second], axis=1)


def _leaf_sides(points_world: np.ndarray, grid: Grid, layout: LeafLevels) -> np.ndarray:
    """Sides (N,) of the leaves around points (N, 3), or of the block in empty ones."""
    last = (1 << layout.block_level) - 1
    cells = np.clip(np.floor(grid.to_unit(points_world) * (last + 1)), 0, last).astype(np.int64)
    levels = layout.levels[morton_encode(cells).astype(np.int64)]
    return grid.side_world / np.exp2(np.where(levels > 0, levels, layout.block_level).astype(np.float64))
