# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of the voxelizer's work: passes over blocks of space, which bound memory, and tasks for cores.

A convex piece K of surface meets 1 + widths along the axes + areas of its shadows on the coordinate planes cells of a
grid of unit cells, on average over the grid's position: the volume of K thickened by a cell (Steiner's formula).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..cells.morton_kernels import cell_key
from ..runtime.kernels import device, kernel
from ..surface.mesh import MeshSource
from .clip import BRICK_LEVELS
from .grid import Grid
from .leaf_levels import LeafLevels

FRAGMENTS_PER_TASK = 1 << 18
MIN_SHARE = 50_000  # least fragments for a separate core
BLOCK_LEVEL = 5  # level of the blocks of a pass, if all leaves are on one level
_TASK_STEPS = 32  # most points along a triangle's edge by which its work is estimated


@dataclass(frozen=True, eq=False)
class CellSet:
    """Requested cells of one level, for `clip_triangles`.

    near, block: (wanted, shift) each, by the Morton key of a brick or a cell, >> shift (uint64): (n,) bool, and (n,)
    uint8, the level in requested blocks and 0 in others.
    """

    near: tuple[np.ndarray, np.uint64]
    block: tuple[np.ndarray, np.uint64]

    @classmethod
    def of_blocks(cls, wanted: np.ndarray, level: int) -> CellSet:
        """Cells of `level` in the requested ones (8^b,) bool of all blocks."""
        block_level = (len(wanted).bit_length() - 1) // 3
        brick_level = max(level - BRICK_LEVELS, 0)
        near, coarser = wanted, brick_level - block_level
        if coarser < 0:  # a brick contains several blocks
            near, coarser = wanted.reshape(-1, 8**-coarser).any(axis=1), 0
        levels = wanted.astype(np.uint8) * np.uint8(level)
        return cls((near, np.uint64(3 * coarser)), (levels, np.uint64(3 * (level - block_level))))


def all_cells(level: int) -> CellSet:
    """Cells of the whole cube."""
    return CellSet.of_blocks(np.ones(1, np.bool_), level)


@dataclass(frozen=True)
class BlockRange:
    """Consecutive blocks first..end-1 of `layout`'s, the work of one core."""

    layout: LeafLevels
    first: int
    end: int

    def cells(self) -> dict[int, CellSet]:
        """Cells that become leaves, level by level, coarse first."""
        levels = self.layout.levels
        sets = {}
        for level in LeafLevels(levels[self.first : self.end]).used:
            wanted = np.zeros(len(levels), np.bool_)
            np.equal(levels[self.first : self.end], level, out=wanted[self.first : self.end])
            sets[level] = CellSet.of_blocks(wanted, level)
        return sets


def plan_passes(
    source: MeshSource, grid: Grid, layout: LeafLevels, max_fragments: int, cores: int = 1
) -> tuple[list[list[BlockRange]], float]:
    """Plan passes over the triangles, each over blocks with about `max_fragments`, in Morton order.

    Each has as many ranges of similar load as there are cores; reads the triangles once. With them, the expected number
    of fragments.
    """
    blocks = layout.divided(BLOCK_LEVEL)
    load = expected_fragments(source, grid, blocks)
    filled = np.flatnonzero(load)
    load = load[filled]
    total = float(load.sum())
    passes = max(int(np.ceil(total / max_fragments)), 1)
    shares = max(min(cores, int(total / passes / MIN_SHARE)), 1)
    # A block belongs to the range of its middle fragment, so that rounding leaves no empty range.
    number = np.minimum((np.cumsum(load) - load / 2) * (passes * shares / max(total, 1.0)), passes * shares - 1)
    starts = np.searchsorted(number.astype(np.int64), np.arange(passes * shares + 1))
    cuts = np.append(filled, len(blocks.levels))[starts]
    cuts[0] = 0
    ranges = [BlockRange(blocks, int(first), int(end)) for first, end in pairwise(cuts)]
    return [ranges[first : first + shares] for first in range(0, len(ranges), shares)], total


def expected_fragments(source: MeshSource, grid: Grid, layout: LeafLevels) -> np.ndarray:
    """Expected fragments (blocks,) float64 of the leaves in each block."""
    load = np.zeros(len(layout.levels), np.float64)
    shift = np.uint64(3 * (grid.depth - layout.block_level))
    for batch in source.batches():
        _expect(to_cells(batch.corners_world, grid, grid.depth), grid.depth, layout.levels, shift, 0, load)
    return load


def to_cells(corners_world: np.ndarray, grid: Grid, level: int) -> np.ndarray:
    """Corners (T, 3, 3) float64 in units of the cells of a level."""
    side = grid.side_world / (1 << level)
    return np.ascontiguousarray((corners_world - np.asarray(grid.origin_world)) / side, np.float64)


def tasks_of(corners_voxel: np.ndarray, resolution: int, cells: CellSet) -> Iterator[tuple[int, int, tuple[int, int]]]:
    """Ranges first, last, (x_first, x_last) of similar work in requested cells; a huge triangle is split along x."""
    work = np.zeros(len(corners_voxel), np.float64)
    _expect(corners_voxel, resolution.bit_length() - 1, *cells.block, _TASK_STEPS, work)
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
                yield first, last, (int(x_first), int(x_last))
        else:
            yield first, last, (0, resolution)
        first = last


@device
def _extents(corners):
    """Sum of the widths, sum of the shadows' areas, and the largest width of one triangle (3, 3)."""
    widths = 0.0
    shadows = 0.0
    widest = 0.0
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        low = min(corners[0, axis], corners[1, axis], corners[2, axis])
        high = max(corners[0, axis], corners[1, axis], corners[2, axis])
        shadow = (corners[1, a] - corners[0, a]) * (corners[2, b] - corners[0, b])
        shadow -= (corners[1, b] - corners[0, b]) * (corners[2, a] - corners[0, a])
        widths += high - low
        shadows += 0.5 * abs(shadow)
        widest = max(widest, high - low)
    return widths, shadows, widest


@kernel
def _expect(
    corners_voxel: np.ndarray, depth: int, levels: np.ndarray, shift: np.uint64, most: int, expected: np.ndarray
) -> None:
    """Add the expected fragments of each triangle to those of its blocks, by points spread over it.

    corners_voxel: in cells of level `depth`; a block's leaves may be on a coarser level. most: points along an edge,
    for those of the triangle itself; 0: of its blocks, by two points in each.
    """
    side = 2.0 ** (np.int64(shift) // 3)
    for triangle in range(len(corners_voxel)):
        corners = corners_voxel[triangle]
        widths, shadows, widest = _extents(corners)
        steps = 1 + int(2.0 * widest / side)
        if most > 0:
            steps = min(steps, most)
        points = steps * (steps + 1) // 2
        for i in range(steps):
            for j in range(steps - i):
                x, y, z = _point(corners, (i + 1.0 / 3.0) / steps, (j + 1.0 / 3.0) / steps, np.int64(1) << depth)
                block = cell_key(x, y, z) >> shift
                if levels[block] > 0:
                    scale = 1.0 / (np.int64(1) << (depth - levels[block]))
                    found = (1.0 + scale * (widths + scale * shadows)) / points
                    expected[np.uint64(triangle) if most > 0 else block] += found


@device
def _point(corners, u, v, resolution):
    """Cell of the point with weights (1 - u - v, u, v)."""
    x = corners[0, 0] + u * (corners[1, 0] - corners[0, 0]) + v * (corners[2, 0] - corners[0, 0])
    y = corners[0, 1] + u * (corners[1, 1] - corners[0, 1]) + v * (corners[2, 1] - corners[0, 1])
    z = corners[0, 2] + u * (corners[1, 2] - corners[0, 2]) + v * (corners[2, 2] - corners[0, 2])
    top = resolution - 1
    return (
        min(max(int(x), 0), top),
        min(max(int(y), 0), top),
        min(max(int(z), 0), top),
    )
