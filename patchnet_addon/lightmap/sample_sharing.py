# SPDX-License-Identifier: GPL-3.0-or-later
"""Share paths between texels: where a voxel has more texels than its surface needs, each gets fewer paths.

A triangle has at least one texel, however small it is. In a bush, a voxel of a texel's size contains hundreds of them;
with all paths in each, most of the bake would be invisible. So triangles share: those of one material in one cell of a
texel's side together get the paths of the texels that fit their area, and at least those of one texel. Every triangle
keeps its own texel, so that the mean over them is unbiased.
"""

from __future__ import annotations

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..runtime.progress import Progress, Steps
from ..surface.mesh import MeshSource

_LARGE = 2.0  # texels along the longest edge: larger triangles span many cells and do not share


def crowding_of(
    source: MeshSource, texel_world: np.ndarray, texels: np.ndarray
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Excess of paths of all T triangles of a surface, and groups of those that share paths.

    Excess (T,) float32, at least 1: texels in the triangle's cell over those that its surface needs. Groups (T,) int32
    are equal for triangles that share a cell.

    texel_world: (T,) float32, requested texel side of each. texels: (T,) its number of texels.
    """
    count = source.triangle_count
    keys, wanted = np.empty(count, np.uint64), np.empty(count, np.float32)
    origin, least = source.bounds_world[0], float(texel_world.min(initial=np.inf))
    for batch in source.batches():
        part = slice(batch.first_triangle, batch.first_triangle + len(batch))
        side = texel_world[part].astype(np.float64)
        wanted[part] = triangle_areas_and_normals(batch.corners_world)[0] / side**2
        keys[part] = _keys(batch.corners_world, side, origin, least, batch.materials)
        large = np.flatnonzero(_longest(batch.corners_world) > _LARGE * side)
        keys[part][large] = _ALONE | (large + batch.first_triangle).astype(np.uint64)
        yield Progress(part.stop, count, "Laying out charts")
    _, group = np.unique(keys, return_inverse=True)
    group = group.reshape(-1)
    present = np.bincount(group, texels)
    asked = np.maximum(np.bincount(group, wanted), 1.0)
    excess = np.maximum(present / asked, 1.0).astype(np.float32)
    return excess[group], group.astype(np.int32)


_ALONE = np.uint64(1 << 63)
_PRIMES = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


def _keys(
    corners_world: np.ndarray, side: np.ndarray, origin: np.ndarray, least: float, materials: np.ndarray
) -> np.ndarray:
    """(N,) uint64 below 2^63: a hash of cell, its size and material; cells are 2^k times the least texel wide."""
    size = np.floor(np.log2(side / least) + 1e-6)
    cell = np.floor((corners_world.mean(axis=1) - origin) / (least * np.exp2(size))[:, None]).astype(np.int64)
    mixed = (materials.astype(np.uint64) << np.uint64(8)) + size.astype(np.uint64) + np.uint64(1)
    for axis in range(3):
        mixed = (mixed ^ cell[:, axis].astype(np.uint64)) * _PRIMES[axis]
        mixed ^= mixed >> np.uint64(29)
    return mixed >> np.uint64(1)


def _longest(corners_world: np.ndarray) -> np.ndarray:
    """(N,) lengths of the longest edges of triangles."""
    edges = np.roll(corners_world, -1, axis=1) - corners_world
    return np.sqrt((edges * edges).sum(axis=-1).max(axis=-1))
