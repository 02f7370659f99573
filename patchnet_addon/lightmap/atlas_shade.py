# SPDX-License-Identifier: GPL-3.0-or-later
"""Shading with an atlas of baked light: its texels, with texture finer than them put back (methods 7.2b to 7.2d)."""

from __future__ import annotations

import functools

import numpy as np

from ..runtime.errors import SettingError
from ..runtime.quantities import counted
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.mesh import Fragments, MeshSource, ShadingFn, TriangleBatch
from ..surface.texture_color import color_of_fragments
from ..surface.texture_lookup import surface_of_fragments
from ..surface.textures import TextureTable
from .atlas import COLOR_CHANNELS, MIN_OPACITY, Atlas
from .chart_lookup import lookup, triangle_means
from .charts import Charts
from .irradiance import irradiance_of_materials
from .texel_bases import base_of_texels
from .texture_detail import detailed, has_detail, hue_detail, texture_detail


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
            f"The baked light has {counted(len(atlas.charts.page), 'triangle')}, the surface {source.triangle_count}: "
            "bake the light again"
        )
    channels = atlas.texels.shape[1]
    colored = channels == COLOR_CHANNELS
    table = TextureTable.from_materials(source.materials, color=colored)
    charts, texels = atlas.charts, _with_bases(atlas, source) if has_detail(table).any() else atlas.texels

    @functools.cache
    def irradiance() -> np.ndarray:
        return irradiance_of_materials(charts, texels, table, source, MIN_OPACITY)

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, ...]:
        albedo, opacity = surface_of_fragments(table, batch, fragments)
        triangles = fragments.triangle.astype(np.int64) + batch.first_triangle
        values = lookup(charts, texels, triangles, fragments.barycentric)
        lost = (values[:, 1] <= MIN_OPACITY) & (opacity > 0.0)
        values[lost] = _triangle_values(charts, texels, triangles[lost])
        seen = values[:, 1] > MIN_OPACITY
        values /= np.where(seen, values[:, 1], np.inf)[:, None]
        fine, held = detailed(table, batch, fragments, opacity), values[:, channels:]
        luminance = values[:, 0].copy()
        if len(fine):
            luminance[fine] *= texture_detail(albedo[fine], held[fine, 0])
        lost = ~seen & (opacity > 0.0)
        if lost.any():
            luminance[lost] = albedo[lost] * irradiance()[batch.materials[fragments.triangle[lost]]]
        if not colored:
            return luminance, opacity
        base = color_of_fragments(table, batch, fragments, np.ones(len(fragments), np.float32))
        hue = _rgb(values[:, 0], values[:, 2], values[:, 3])
        if len(fine):
            hue[fine] *= hue_detail(base[fine], _rgb(*held[fine].T))
        return luminance, opacity, np.where(lost[:, None], base, hue)

    return shade


def _with_bases(atlas: Atlas, source: MeshSource) -> np.ndarray:
    """Texels (N, C) and, in further channels, their base colours weighed by opacity."""
    base = base_of_texels(atlas, source) if atlas.base is None else atlas.base
    return np.concatenate([atlas.texels, base * atlas.texels[:, 1:2]], axis=1)


def _rgb(luminance: np.ndarray, red: np.ndarray, blue: np.ndarray) -> np.ndarray:
    """Colours (n, 3) of a luminance (n,), red and blue; green is what is left."""
    green = np.maximum((luminance - np.float32(RED) * red - np.float32(BLUE) * blue) / np.float32(GREEN), 0.0)
    return np.stack([red, green, blue], axis=-1)


def _triangle_values(charts: Charts, texels: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Means (n, C) over all texels of triangles (n,): at the edge of a cut-out, a texel may have met the gap only."""
    distinct, inverse = np.unique(triangles, return_inverse=True)
    return triangle_means(charts, texels, distinct)[inverse.reshape(-1)].astype(np.float32)
