# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaf sums -> Octree: exact means of all levels, bottom-up (methods 7.2)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..light.exposure import quantile_exposure
from ..progress import Steps
from .grid import Grid
from .leaf_levels import LeafLevels
from .levels import hierarchy, round_means, sums_of_level
from .mesh import MeshSource, Shade
from .octree import Octree
from .voxelize import LeafSums, voxelize


def build_octree(
    source: MeshSource,
    grid: Grid,
    shade: Shade,
    *,
    layout: LeafLevels | None = None,
    exposure: float | None = None,
    provenance: dict[str, Any] | None = None,
) -> Steps[Octree]:
    """Voxelize `source` on `grid` with the luminance and opacity of `shade`.

    layout: levels of the leaves, at most the grid's depth; None puts all on that.
    exposure: factor on luminance before it is clamped to [0, 1] at the leaves; None chooses it so that the
    99.5 % quantile of leaf luminance becomes 1 (methods 7.1).
    Raises GeometryError when no opaque surface is left.
    """
    leaves = yield from voxelize(source, grid, shade, layout=layout)
    return octree_from_leaves(leaves, grid, exposure=exposure, provenance=provenance)


def octree_from_leaves(
    leaves: list[LeafSums],
    grid: Grid,
    *,
    exposure: float | None = None,
    provenance: dict[str, Any] | None = None,
) -> Octree:
    """Octree over the leaf sums of one or several levels, no leaf within another one.

    leaves: emptied, so that their keys are let go as soon as the nodes are known.
    Parents integrate their children in float64, then all are rounded. Levels deeper than the finest leaf are left out.
    """
    grid = replace(grid, depth=max(part.level for part in leaves))
    if exposure is None:
        exposure = quantile_exposure(np.concatenate([part.sums[:, 1] / part.sums[:, 0] for part in leaves]))
    level_start, child_mask, first_child = hierarchy({part.level: part.keys for part in leaves}, grid.depth)
    sums = {part.level: part.sums for part in leaves}
    leaves.clear()
    count = len(child_mask)
    octree = Octree(
        grid=grid,
        level_start=level_start,
        child_mask=child_mask,
        first_child=first_child,
        area_world=np.empty(count, np.float32),
        luminance=np.empty(count, np.uint16),
        normal=np.empty((count, 3), np.int8),
        exposure=float(exposure),
        provenance=provenance or {},
    )
    _fill_levels(octree, sums)
    return octree


def _fill_levels(octree: Octree, leaf_sums: dict[int, np.ndarray]) -> None:
    """Means of all levels, bottom-up; only two levels' sums exist at a time beside those of the leaves."""
    none = np.empty((0, 5), np.float32)
    sums, exposure = leaf_sums[octree.depth], octree.exposure
    for level in range(octree.depth, -1, -1):
        nodes = octree.level(level)
        if level < octree.depth:
            below, unexposed = sums, exposure
            sums, exposure = np.zeros((nodes.stop - nodes.start, 5), np.float64), 1.0
            leaves = leaf_sums.get(level, none)
            sums_of_level(octree.child_mask[nodes], below, unexposed, leaves, octree.exposure, sums)
        round_means(sums, exposure, octree.area_world[nodes], octree.luminance[nodes], octree.normal[nodes])
