# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colours of an atlas: divisors of the baked light of its texels (methods 7.2c, 7.2g)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..surface.mesh import MeshSource, TriangleBatch
from ..surface.textures import TextureTable
from .atlas import COLOR_CHANNELS, MIN_OPACITY, Atlas
from .base_colors import base_colors
from .chart_lookup import texel_owners
from .charts import Charts
from .packing import SINGLE
from .texel_places import BatchTexels


class TexelBases(NamedTuple):
    """Base colours of the texels of one batch that have surface and do not emit.

    own: n texels. area: (n,) float64, surface of each texel. color: (n, 1) float32, luminance, or (n, 3), with red and
    blue.
    """

    batch: TriangleBatch
    own: BatchTexels
    area: np.ndarray
    color: np.ndarray


def texel_bases(atlas: Atlas, source: MeshSource) -> Iterator[TexelBases]:
    """Base colours of an atlas, batch by batch."""
    colored = atlas.texels.shape[1] == COLOR_CHANNELS
    table = TextureTable.from_materials(source.materials, color=colored)
    charts, (index, triangle) = atlas.charts, _owned(atlas.charts)
    for batch in source.batches():
        first, last = np.searchsorted(triangle, [batch.first_triangle, batch.first_triangle + len(batch)])
        mine, local = index[first:last], triangle[first:last].astype(np.int64) - batch.first_triangle
        plain = table.materials.emission[batch.materials[local]] <= 0.0
        keep = plain & (atlas.texels[mine, 1] > MIN_OPACITY)
        mine, local = mine[keep], local[keep]
        if not len(mine):
            continue
        corners = charts.corner_texels(np.arange(batch.first_triangle, batch.first_triangle + len(batch)))
        own = BatchTexels(mine, local, corners, charts.page_side)
        area = _texel_areas(charts, batch)[local]
        yield TexelBases(batch, own, area, base_colors(table, batch, own, area, spread=atlas.spread, colored=colored))


def base_of_texels(atlas: Atlas, source: MeshSource) -> np.ndarray:
    """Base colours of all texels, as in `Atlas.base`; 0 in unused texels."""
    found = np.zeros((len(atlas.texels), 3 if atlas.texels.shape[1] == COLOR_CHANNELS else 1), np.float32)
    for part in texel_bases(atlas, source):
        found[part.own.texels] = part.color
    return found


def _texel_areas(charts: Charts, batch: TriangleBatch) -> np.ndarray:
    """Area (T,) float64, world units, of one texel on each of the batch's triangles."""
    numbers = slice(batch.first_triangle, batch.first_triangle + len(batch))
    logs = charts.log_width[numbers].astype(np.float64) + charts.log_height[numbers]
    areas, _ = triangle_areas_and_normals(batch.corners_world)
    return np.asarray(areas / np.where(charts.kind[numbers] == SINGLE, 1.0, np.exp2(logs) / 2.0))


def _owned(charts: Charts) -> tuple[np.ndarray, np.ndarray]:
    """Texels (n,) int64 of the atlas with a triangle, and the triangles (n,) int32, in their order."""
    side = charts.page_side**2
    owners = [texel_owners(charts, page) for page in range(charts.page_count)]
    index = np.concatenate([np.flatnonzero(own >= 0) + page * side for page, own in enumerate(owners)])
    triangle = np.concatenate([own[own >= 0] for own in owners])
    order = np.argsort(triangle, kind="stable")
    return index[order], triangle[order]
