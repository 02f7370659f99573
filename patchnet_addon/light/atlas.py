# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked luminance on the charts of a surface, and shading with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SettingError
from ..octree.mesh import Fragments, MeshSource, Shade, TriangleBatch
from .chart_lookup import lookup
from .charts import Charts
from .texture_lookup import surface_of_fragments
from .textures import TextureTable

_LEAST_OPACITY = 1e-3


@dataclass(frozen=True, eq=False)
class Atlas:
    """Baked light of a surface.

    charts: where its triangles lie. texels: (pages * side * side, 2) float32, luminance weighed by opacity, and
    opacity, as the renderer saw it at the texel. samples: paths a texel. warnings: sentences about what was left out.
    """

    charts: Charts
    texels: np.ndarray
    samples: int = 0
    warnings: tuple[str, ...] = ()


def atlas_shade(atlas: Atlas, source: MeshSource) -> Shade:
    """Shade that reads baked luminance at the centroid of each fragment; opacity is the material's own.

    Raises SettingError if the atlas was laid out for another surface.
    """
    if len(atlas.charts.page) != source.triangle_count:
        raise SettingError(
            f"The baked light has {len(atlas.charts.page)} triangles, the surface {source.triangle_count}: "
            "bake the light again"
        )
    table = TextureTable.from_materials(source.materials)

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, np.ndarray]:
        _, opacity = surface_of_fragments(table, batch, fragments)
        triangles = fragments.triangle.astype(np.int64) + batch.first_triangle
        values = lookup(atlas.charts, atlas.texels, triangles, fragments.barycentric)
        seen = values[:, 1] > _LEAST_OPACITY
        return np.where(seen, values[:, 0] / np.where(seen, values[:, 1], 1.0), 0.0).astype(np.float32), opacity

    return shade
