# SPDX-License-Identifier: GPL-3.0-or-later
"""Dividing the voxelizer's work: blocks of space, so that memory stays bounded, and tasks of similar size for cores.

A convex piece K of surface meets 1 + widths along the axes + areas of its shadows on the coordinate planes cells of a
grid of unit cells, on average over the grid's position: the volume of K thickened by a cell (Steiner's formula).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..kernels import device, serial_kernel
from .clip import cell_key
from .grid import Grid
from .mesh import MeshSource

FRAGMENTS_PER_TASK = 1 << 18
_LEVEL = 5  # blocks are nodes of this level


@dataclass(frozen=True, eq=False)
class BlockSet:
    """Blocks whose leaves are made in one pass over the triangles.

    wanted: (8^level,) bool over the blocks' Morton keys. shift: uint64, from a leaf's key to its block's.
    """

    wanted: np.ndarray
    shift: np.uint64


def all_blocks(grid: Grid) -> BlockSet:
    """The whole cube."""
    return BlockSet(np.ones(1, np.bool_), np.uint64(3 * grid.depth))


def plan_blocks(source: MeshSource, grid: Grid, most_fragments: int) -> list[BlockSet]:
    """Sets of blocks with about `most_fragments` each, in Morton order; reads the triangles once."""
    level = min(_LEVEL, grid.depth)
    shift = np.uint64(3 * (grid.depth - level))
    load = np.zeros(8**level, np.float64)
    for batch in source.batches():
        _add_load(to_voxels(batch.corners_world, grid), grid.resolution, shift, grid.depth - level, load)
    if load.sum() <= most_fragments:
        return [all_blocks(grid)]
    number = ((np.cumsum(load) - load) // most_fragments).astype(np.int64)
    return [BlockSet(number == value, shift) for value in np.unique(number)]


def to_voxels(corners_world: np.ndarray, grid: Grid) -> np.ndarray:
    """Corners (T, 3, 3) float64 in units of leaf cells."""
    return np.ascontiguousarray((corners_world - np.asarray(grid.origin_world)) / grid.voxel_world, np.float64)


def tasks_of(corners_voxel: np.ndarray, resolution: int) -> Iterator[tuple[int, int, int, int]]:
    """Ranges (first, last, x_first, x_last) of similar work; one huge triangle is divided along x."""
    work = np.empty(len(corners_voxel), np.float64)
    _expected_fragments(corners_voxel, work)
    ends = np.cumsum(work)
    first = 0
    while first < len(work):
        before = ends[first - 1] if first else 0.0
        last = max(first + 1, int(np.searchsorted(ends, before + FRAGMENTS_PER_TASK, side="right")))
        if last == first + 1 and work[first] > 2 * FRAGMENTS_PER_TASK:
            pieces = int(np.ceil(work[first] / FRAGMENTS_PER_TASK))
            x = corners_voxel[first, :, 0]
            low, high = np.clip(np.floor([x.min(), x.max()]), 0, resolution - 1)
            for x_first, x_last in pairwise(np.unique(np.linspace(low, high + 1, pieces + 1).astype(int))):
                yield first, last, int(x_first), int(x_last)
        else:
            yield first, last, 0, resolution
        first = last


@device
def _fragments(corners):  # type: ignore[no-untyped-def]
    """Expected number of fragments of one triangle (3, 3) in units of cells."""
    total = 1.0
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        low = min(corners[0, axis], corners[1, axis], corners[2, axis])
        high = max(corners[0, axis], corners[1, axis], corners[2, axis])
        shadow = (corners[1, a] - corners[0, a]) * (corners[2, b] - corners[0, b])
        shadow -= (corners[1, b] - corners[0, b]) * (corners[2, a] - corners[0, a])
        total += high - low + 0.5 * abs(shadow)
    return total


@serial_kernel
def _expected_fragments(corners_voxel, work):  # type: ignore[no-untyped-def]
    for triangle in range(len(corners_voxel)):
        work[triangle] = _fragments(corners_voxel[triangle])


@serial_kernel
def _add_load(corners_voxel, resolution, shift, block_depth, load):  # type: ignore[no-untyped-def]
    """Add each triangle's expected fragments to the blocks it lies in, by points spread over it."""
    side = 2.0**block_depth
    for triangle in range(len(corners_voxel)):
        corners = corners_voxel[triangle]
        extent = 0.0
        for axis in range(3):
            low = min(corners[0, axis], corners[1, axis], corners[2, axis])
            high = max(corners[0, axis], corners[1, axis], corners[2, axis])
            extent = max(extent, high - low)
        steps = 1 + int(2.0 * extent / side)
        share = _fragments(corners) / (steps * (steps + 1) // 2)
        for i in range(steps):
            for j in range(steps - i):
                u = (i + 1.0 / 3.0) / steps
                v = (j + 1.0 / 3.0) / steps
                x, y, z = _point(corners, u, v, resolution)
                load[cell_key(x, y, z) >> shift] += share


@device
def _point(corners, u, v, resolution):  # type: ignore[no-untyped-def]
    """Cell of the point with weights u, v of corners 1 and 2, clamped to the grid."""
    cell = np.empty(3, np.int64)
    for axis in range(3):
        value = corners[0, axis] + u * (corners[1, axis] - corners[0, axis]) + v * (corners[2, axis] - corners[0, axis])
        cell[axis] = min(max(int(np.floor(value)), 0), resolution - 1)
    return cell[0], cell[1], cell[2]
