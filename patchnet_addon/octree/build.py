# SPDX-License-Identifier: GPL-3.0-or-later
"""Leaf sums -> Octree: exact means of all levels, bottom-up (methods 7.2)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..light.exposure import quantile_exposure
from ..progress import Steps
from .grid import Grid
from .mesh import MeshSource, Shade
from .octree import LUMINANCE_SCALE, NORMAL_SCALE, Octree
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
    area = leaves.sums[:, 0]
    luminance = leaves.sums[:, 1] / area
    if exposure is None:
        exposure = quantile_exposure(luminance)
    sums = leaves.sums.copy()
    sums[:, 1] = area * np.clip(luminance * exposure, 0.0, 1.0)
    keys, mask = leaves.keys, np.zeros(len(area), np.uint8)
    levels = [(mask, sums)]
    for _ in range(grid.depth):
        keys, mask, sums = _parents(keys, sums)
        levels.append((mask, sums))
    levels.reverse()
    return _assemble(levels, grid, exposure, provenance or {})


def _parents(keys: np.ndarray, sums: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Keys, child masks and sums of the next coarser level."""
    parents = keys >> np.uint64(3)
    starts = np.flatnonzero(np.concatenate([[True], parents[1:] != parents[:-1]]))
    bits = np.left_shift(np.uint8(1), (keys & np.uint64(7)).astype(np.uint8))
    return parents[starts], np.bitwise_or.reduceat(bits, starts), np.add.reduceat(sums, starts, axis=0)


def _assemble(
    levels: list[tuple[np.ndarray, np.ndarray]], grid: Grid, exposure: float, provenance: dict[str, Any]
) -> Octree:
    """Concatenate levels, root first, and round their means to the stored precision."""
    child_mask = np.concatenate([mask for mask, _ in levels])
    counts = [len(mask) for mask, _ in levels]
    child_counts = np.unpackbits(child_mask[:, None], axis=1).sum(axis=1, dtype=np.int64)
    first_child = (1 + np.concatenate([[0], np.cumsum(child_counts)[:-1]])).astype(np.uint32)
    area = np.concatenate([sums[:, 0] for _, sums in levels])
    means = np.concatenate([sums[:, 1:] / sums[:, :1] for _, sums in levels])
    return Octree(
        grid=grid,
        level_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        child_mask=child_mask,
        first_child=first_child,
        area_world=area.astype(np.float32),
        luminance=np.rint(np.clip(means[:, 0], 0.0, 1.0) * LUMINANCE_SCALE).astype(np.uint16),
        normal=np.rint(np.clip(means[:, 1:], -1.0, 1.0) * NORMAL_SCALE).astype(np.int8),
        exposure=float(exposure),
        provenance=provenance,
    )
