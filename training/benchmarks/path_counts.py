# SPDX-License-Identifier: GPL-3.0-or-later
"""Path counts: how many paths of a bake a voxel's light rests on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.lightmap.chart_lookup import texel_owners
from ...patchnet_addon.lightmap.charts import Charts
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.leaf_levels import LeafLevels
from ...patchnet_addon.octree.voxelize import LeafSums, triangle_areas_and_normals, voxelize
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.surface.mesh import Fragments, MeshSource, ShadingFn, TriangleBatch


@dataclass(frozen=True, eq=False)
class PathCounts:
    """Paths on one side of the surface in each voxel.

    leaf: (n,) float64, leaves. stop: (m,) float64, the voxels `lookahead` levels above them, in which rays stop
    that have their whole look-ahead.
    """

    leaf: np.ndarray
    stop: np.ndarray


def own_texels(charts: Charts) -> np.ndarray:
    """(T,) int64: texels that belong to each triangle."""
    total = np.zeros(len(charts.page), np.int64)
    for page in range(charts.page_count):
        owners = texel_owners(charts, page)
        total += np.bincount(owners[owners >= 0], minlength=len(total))
    return total


def path_counts(
    source: MeshSource,
    charts: Charts,
    grid: Grid,
    layout: LeafLevels | None = None,
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
) -> Steps[PathCounts]:
    """Count the paths of a bake on `charts` by voxel: of a triangle that is cut, each piece counts by its area."""
    paths = own_texels(charts) * charts.page_samples[charts.page]

    def density(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, np.ndarray]:
        areas = np.maximum(triangle_areas_and_normals(batch.corners_world)[0], 1e-30)
        there = paths[batch.first_triangle : batch.first_triangle + len(batch)] / areas
        return there[fragments.triangle].astype(np.float32), np.ones(len(fragments), np.float32)

    shade: ShadingFn = density
    leaves = yield from voxelize(source, grid, shade, _counted, layout=layout)
    pairs = [pair for part in leaves for pair in part]
    leaf = np.concatenate([values for _, values in pairs]) if pairs else np.empty(0)
    above = [_above(keys, values, lookahead) for keys, values in pairs]
    return PathCounts(leaf, np.concatenate(above) if above else np.empty(0))


def _counted(leaves: list[LeafSums], _block_level: int) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(level.keys, level.sums[:, 1].astype(np.float64)) for level in leaves]


def _above(keys: np.ndarray, values: np.ndarray, lookahead: int) -> np.ndarray:
    """Sums (m,) of values (n,) over the cells `lookahead` levels above; keys ascend."""
    starts = np.flatnonzero(np.diff(keys >> np.uint64(3 * lookahead), prepend=np.uint64(2**64 - 1)))
    return np.add.reduceat(values, starts) if len(values) else values
