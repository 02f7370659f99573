# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxel cloud of an octree at one level: its nodes there, and coarser leaves.

`voxel_runs` yields them in pieces of bounded size, for files; `voxel_cloud` returns all of them, for the screen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..cells.morton import POPCOUNT, morton_decode
from ..runtime.errors import SettingError
from .octree import Octree

_PIECE = 1 << 17  # nodes of a level per step


@dataclass(frozen=True, eq=False)
class VoxelRun:
    """Run of voxels of one level; columns are computed on demand.

    nodes: (n,) int64 node indices. keys: (n,) uint64 Morton keys of their cells.
    """

    octree: Octree
    level: int
    nodes: np.ndarray
    keys: np.ndarray

    def __len__(self) -> int:
        return len(self.nodes)

    def only(self, chosen: np.ndarray | slice) -> VoxelRun:
        """Select voxels by `chosen`."""
        return VoxelRun(self.octree, self.level, self.nodes[chosen], self.keys[chosen])

    @property
    def side_world(self) -> float:
        """Side of each of these voxels in world units."""
        return self.octree.grid.side_world / (1 << self.level)

    @property
    def cells(self) -> np.ndarray:
        """Integer cells (n, 3) int32 at this run's level."""
        return morton_decode(self.keys)

    @property
    def centres_world(self) -> np.ndarray:
        """Centres (n, 3) float64 in world units."""
        return self.octree.grid.to_world((self.cells + 0.5) / (1 << self.level))

    @property
    def luminance(self) -> np.ndarray:
        """Luminance (n,) float32 in [0, 1]."""
        return self.octree.luminance_float(self.nodes)

    @property
    def color(self) -> np.ndarray:
        """Linear colours (n, 3) float32 of that luminance, channels may be above 1; gray without colour."""
        return self.octree.color_float(self.nodes)

    @property
    def normal(self) -> np.ndarray:
        """Mean normals (n, 3) float32, length at most 1."""
        return self.octree.normal_float(self.nodes)

    @property
    def area_world(self) -> np.ndarray:
        """Surface (n,) float32 in each voxel, weighted by opacity."""
        return self.octree.area_world[self.nodes]


@dataclass(frozen=True, eq=False)
class VoxelCloud:
    """Voxels of one level, all as arrays; those of coarser leaves have a larger side.

    centres_world: (n, 3) float64. side_world: (n,) float32. luminance: (n,) float32 in [0, 1].
    color: (n, 3) float32, linear, of that luminance; gray without colour.
    normal: (n, 3) float32, length at most 1. area_world: (n,) float32.
    """

    centres_world: np.ndarray
    side_world: np.ndarray
    luminance: np.ndarray
    color: np.ndarray
    normal: np.ndarray
    area_world: np.ndarray

    def __len__(self) -> int:
        return len(self.side_world)


def voxel_counts(octree: Octree) -> np.ndarray:
    """Number of voxels (depth + 1,) int64 of each level's cloud; it does not decrease with the level."""
    levels = range(octree.depth + 1)
    leaves = np.array([np.count_nonzero(octree.child_mask[octree.level(level)] == 0) for level in levels])
    coarser = np.cumsum(leaves) - leaves
    return np.diff(octree.level_start) + coarser


def check_level(octree: Octree, level: int) -> int:
    """Check `level` and return it; raises SettingError outside the octree's levels."""
    if not 0 <= level <= octree.depth:
        raise SettingError(
            f"Level {level} is outside 0 to {octree.depth}, the levels of the octree: choose one of them"
        )
    return level


def level_within(octree: Octree, limit: int, finest: int | None = None) -> int:
    """Finest level, up to `finest`, with at most `limit` voxels.

    Raises SettingError if `limit` is below 1 or `finest` is not a level of the octree.
    """
    if limit < 1:
        raise SettingError(f"A limit of {limit} voxels shows none: choose at least 1")
    finest = octree.depth if finest is None else check_level(octree, finest)
    fitting = int(np.searchsorted(voxel_counts(octree), limit, side="right")) - 1
    return min(fitting, finest)


def voxel_runs(octree: Octree, level: int, top: VoxelRun | None = None, piece: int = _PIECE) -> Iterator[VoxelRun]:
    """Voxels of `level`'s cloud, below the nodes of `top` or all of them, in a fixed order.

    Memory is bounded by `piece` nodes per level: the octree is traversed depth first, many neighbouring nodes at a
    time.
    """
    stack = [top or VoxelRun(octree, 0, np.zeros(1, np.int64), np.zeros(1, np.uint64))]
    while stack:
        run = stack.pop()
        if run.level == level:
            yield run
            continue
        leaf = octree.child_mask[run.nodes] == 0
        if leaf.any():
            yield run.only(leaf)
        children = _children(run.only(~leaf))
        stack += [children.only(slice(begin, begin + piece)) for begin in range(0, len(children), piece)][::-1]


def _children(run: VoxelRun) -> VoxelRun:
    """All children of inner nodes in order."""
    mask = run.octree.child_mask[run.nodes]
    parent, octant = np.nonzero(np.unpackbits(mask[:, None], axis=1, bitorder="little"))  # each (m,)
    counts = POPCOUNT[mask].astype(np.int64)
    sibling = np.arange(len(parent)) - np.repeat(np.cumsum(counts) - counts, counts)  # among its siblings
    nodes = run.octree.first_child[run.nodes[parent]].astype(np.int64) + sibling
    return VoxelRun(run.octree, run.level + 1, nodes, (run.keys[parent] << np.uint64(3)) | octant.astype(np.uint64))


def voxel_cloud(octree: Octree, level: int) -> VoxelCloud:
    """Collect the voxels of `level`; raises SettingError outside the octree's levels."""
    runs = list(voxel_runs(octree, check_level(octree, level)))
    return VoxelCloud(
        centres_world=np.concatenate([run.centres_world for run in runs]),
        side_world=np.concatenate([np.full(len(run), run.side_world, np.float32) for run in runs]),
        luminance=np.concatenate([run.luminance for run in runs]),
        color=np.concatenate([run.color for run in runs]),
        normal=np.concatenate([run.normal for run in runs]),
        area_world=np.concatenate([run.area_world for run in runs]),
    )
