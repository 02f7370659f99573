# SPDX-License-Identifier: GPL-3.0-or-later
"""Atlas of baked luminance on the charts of a surface, and shading with it."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..runtime.errors import SettingError
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.mesh import Fragments, MeshSource, ShadingFn, TriangleBatch
from ..surface.texture_color import color_of_fragments
from ..surface.texture_lookup import surface_of_fragments
from ..surface.textures import TextureTable
from .chart_lookup import lookup, triangle_means
from .charts import Charts
from .irradiance import irradiance_of_materials
from .texture_detail import hue_detail, texture_detail

COLOR_CHANNELS = 4  # of texels with colour
MIN_OPACITY = 1e-3


@dataclass(frozen=True, eq=False)
class Atlas:
    """Baked light of a surface.

    charts: where its triangles lie. texels: (pages * side * side, 2) float32, luminance weighed by opacity, and
    opacity, as the renderer saw it at the texel; with colour (.., 4), red and blue weighed by opacity too.
    noise: (pages * side * side,) float32, half of what two halves of the bake differ by, of luminance weighed by
    opacity; None where it is not known. samples: paths a texel. warnings: sentences about what was left out.
    notes: what was baked, for reports, as plain JSON values.
    spread: side of the square around a texel's centre that its paths go out from, in texels.
    turned: (T,) bool, triangles whose texels hold the light of their back; None where all have that of their front.
    """

    charts: Charts
    texels: np.ndarray
    samples: int = 0
    warnings: tuple[str, ...] = ()
    noise: np.ndarray | None = None
    notes: dict[str, Any] = field(default_factory=dict)
    spread: float = 1.0
    turned: np.ndarray | None = None


def atlas_shade(atlas: Atlas, source: MeshSource) -> ShadingFn:
    """ShadingFn that reads baked luminance at the centroid of each fragment; opacity is the material's own.

    Texture that is finer than the texels of the bake is put back (`texture_detail`). With colour in the atlas it is a
    shade of colour.

    Where the bake met only gaps of a cut-out, the triangle's other texels count, and where it has none, the base colour
    under the light that falls on its material elsewhere.
    Raises SettingError if the atlas was laid out for another surface.
    """
    if len(atlas.charts.page) != source.triangle_count:
        raise SettingError(
            f"The baked light has {len(atlas.charts.page)} triangles, the surface {source.triangle_count}: "
            "bake the light again"
        )
    colored = atlas.texels.shape[1] == COLOR_CHANNELS
    table = TextureTable.from_materials(source.materials, color=colored)

    @functools.cache
    def irradiance() -> np.ndarray:
        return irradiance_of_materials(atlas.charts, atlas.texels, table, source, MIN_OPACITY)

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, ...]:
        albedo, opacity = surface_of_fragments(table, batch, fragments)
        triangles = fragments.triangle.astype(np.int64) + batch.first_triangle
        values = lookup(atlas.charts, atlas.texels, triangles, fragments.barycentric)
        lost = (values[:, 1] <= MIN_OPACITY) & (opacity > 0.0)
        values[lost] = _triangle_values(atlas, triangles[lost])
        seen = values[:, 1] > MIN_OPACITY
        luminance = np.where(seen, values[:, 0] / np.where(seen, values[:, 1], 1.0), 0.0).astype(np.float32)
        luminance *= texture_detail(atlas.charts, table, batch, fragments, albedo, opacity)
        lost = ~seen & (opacity > 0.0)
        if lost.any():
            luminance[lost] = albedo[lost] * irradiance()[batch.materials[fragments.triangle[lost]]]
        if not colored:
            return luminance, opacity
        base = color_of_fragments(table, batch, fragments, np.ones(len(fragments), np.float32))
        hue = _baked_hue(values) * hue_detail(atlas.charts, table, batch, fragments, base, opacity)
        return luminance, opacity, np.where(lost[:, None], base, hue)

    return shade


def _baked_hue(values: np.ndarray) -> np.ndarray:
    """Colours (n, 3) of any brightness of values (n, 4) of texels; green is what is left of luminance."""
    red, blue = values[:, 2], values[:, 3]
    green = np.maximum((values[:, 0] - np.float32(RED) * red - np.float32(BLUE) * blue) / np.float32(GREEN), 0.0)
    return np.stack([red, green, blue], axis=-1)


def _triangle_values(atlas: Atlas, triangles: np.ndarray) -> np.ndarray:
    """Means (n, C) over all texels of triangles (n,): at the edge of a cut-out, a texel may have met the gap only."""
    distinct, inverse = np.unique(triangles, return_inverse=True)
    return triangle_means(atlas.charts, atlas.texels, distinct)[inverse.reshape(-1)].astype(np.float32)
