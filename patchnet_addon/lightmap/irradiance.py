# SPDX-License-Identifier: GPL-3.0-or-later
"""Irradiance of each material, summed so that the order of its triangles does not matter."""

from __future__ import annotations

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..surface.mesh import Fragments, MeshSource, TriangleBatch
from ..surface.texture_lookup import surface_of_fragments
from ..surface.textures import TextureTable
from .chart_lookup import triangle_means
from .charts import Charts

_MANTISSA_BITS = 24  # of float32
_LOWEST_EXPONENT = -149
_EXPONENTS = 128 - _LOWEST_EXPONENT + 1


class ExactSums:
    """Sums of float32 values per group, exact, and so the same in any order."""

    def __init__(self, groups: int) -> None:
        self._parts = np.zeros((groups, _EXPONENTS), np.int64)  # mantissas by exponent; 2^39 values fit

    def add(self, groups: np.ndarray, values: np.ndarray) -> None:
        """Add values (n,), at least 0 and finite, to their groups (n,)."""
        mantissa, exponent = np.frexp(values.astype(np.float32))
        whole = (mantissa.astype(np.float64) * 2.0**_MANTISSA_BITS).astype(np.int64)
        np.add.at(self._parts, (groups, exponent.astype(np.int64) - _LOWEST_EXPONENT), whole)

    def ratio(self, other: ExactSums) -> np.ndarray:
        """Ratio of this sum to the other's (groups,) float64, rounded once; 0 where the other is 0."""
        pairs = zip(self._integers(), other._integers(), strict=True)
        return np.array([mine / its if its else 0.0 for mine, its in pairs])

    def _integers(self) -> list[int]:
        """Sums in units of the least exponent."""
        return [sum(int(parts[place]) << int(place) for place in np.flatnonzero(parts)) for parts in self._parts]


def irradiance_of_materials(
    charts: Charts, texels: np.ndarray, table: TextureTable, source: MeshSource, min_opacity: float
) -> np.ndarray:
    """Baked luminance per luminance of base colour (M,) float64: means over all triangles that the bake saw.

    texels: (N, 2) float32, luminance weighed by opacity, and opacity. Triangles count by area, but for those with at
    most `min_opacity`.
    """
    light, color = ExactSums(len(source.materials)), ExactSums(len(source.materials))
    for batch in source.batches():
        means = triangle_means(charts, texels, np.arange(len(batch)) + batch.first_triangle)  # (T, 2)
        areas, _ = triangle_areas_and_normals(batch.corners_world)
        albedo, opacity = surface_of_fragments(table, batch, _whole(batch, areas))
        seen = (means[:, 1] > min_opacity) & (opacity > 0.0)  # with no opacity, there is no colour to compare with
        groups = batch.materials[seen]
        light.add(groups, areas[seen] * np.maximum(means[seen, 0], 0.0))
        color.add(groups, areas[seen] * means[seen, 1] * albedo[seen])
    return light.ratio(color)


def _whole(batch: TriangleBatch, areas: np.ndarray) -> Fragments:
    """Whole triangles, each as one fragment."""
    count = len(batch)
    centre = np.full((count, 2), 1.0 / 3.0, np.float32)
    return Fragments(np.zeros(count, np.uint64), np.arange(count, dtype=np.int32), centre, areas)
