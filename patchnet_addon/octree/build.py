# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaf sums -> Octree: exact means of all levels, bottom-up (methods 7.2)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..light.exposure import quantile_exposure
from ..progress import Steps
from .grid import Grid
from .levels import add_to_parents, count_levels, number_children, round_means
from .mesh import MeshSource, Shade
from .octree import Octree
from .voxelize import LeafSums, voxelize


def build_octree(
    source: MeshSource,
    grid: Grid,
    shade: Shade,
    *,
    exposure: float | None = None,
    provenance: dict[str, Any] | None = None,
) -> Steps[Octree]:
    """Voxelize `source` on `grid` with the luminance and opacity of `shade`.

    exposure: factor on luminance before it is clamped to [0, 1] at the leaves; None chooses it so that the
    99.5 % quantile of leaf luminance becomes 1 (methods 7.1).
    Raises GeometryError when no opaque surface is left.
    """
    leaves = yield from voxelize(source, grid, shade)
    return octree_from_leaves(leaves, grid, exposure=exposure, provenance=provenance)


def octree_from_leaves(
    leaves: LeafSums, grid: Grid, *, exposure: float | None = None, provenance: dict[str, Any] | None = None
) -> Octree:
    """Octree of uniform depth over leaf sums; parents integrate their children in float64, then all are rounded."""
    if exposure is None:
        exposure = quantile_exposure(leaves.sums[:, 1] / leaves.sums[:, 0])
    level_start = np.concatenate([[0], np.cumsum(count_levels(leaves.keys, grid.depth))]).astype(np.int64)
    count = int(level_start[-1])
    octree = Octree(
        grid=grid,
        level_start=level_start,
        child_mask=np.zeros(count, np.uint8),
        first_child=np.empty(count, np.uint32),
        area_world=np.empty(count, np.float32),
        luminance=np.empty(count, np.uint16),
        normal=np.empty((count, 3), np.int8),
        exposure=float(exposure),
        provenance=provenance or {},
    )
    _fill_levels(octree, leaves)
    number_children(octree.child_mask, octree.first_child)
    return octree


def _fill_levels(octree: Octree, leaves: LeafSums) -> None:
    """Means of all levels and the masks of inner nodes; only two levels' sums exist at a time."""
    keys, sums, exposure = leaves.keys, leaves.sums, octree.exposure
    for level in range(octree.depth, -1, -1):
        nodes = octree.level(level)
        round_means(sums, exposure, octree.area_world[nodes], octree.luminance[nodes], octree.normal[nodes])
        if level == 0:
            return
        above = octree.level(level - 1)
        parents = above.stop - above.start
        parent_keys, parent_sums = np.empty(parents, np.uint64), np.zeros((parents, 5), np.float64)
        add_to_parents(keys, sums, exposure, parent_keys, parent_sums, octree.child_mask[above])
        keys, sums, exposure = parent_keys, parent_sums, 1.0
