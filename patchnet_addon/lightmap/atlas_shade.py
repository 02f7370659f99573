# SPDX-License-Identifier: GPL-3.0-or-later
"""Shading with an atlas of baked light, with texture detail finer than its texels restored (methods 7.2b to 7.2d)."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..runtime.errors import SettingError
from ..runtime.quantities import counted
from ..surface.chroma import BLUE, GREEN, REC709, RED
from ..surface.mesh import Fragments, MeshSource, ShadingFn, TriangleBatch
from ..surface.texture_lookup import color_of_fragments, surface_of_fragments
from ..surface.textures import TextureTable
from .atlas import COLOR_CHANNELS, MIN_OPACITY, Atlas
from .chart_lookup import lookup, triangle_means
from .charts import Charts
from .texel_bases import base_of_texels

_MAX = 4.0  # largest factor of texture on light, and its inverse: beyond it the two base colours are not of one texel
_LEAST_HUE = 1.0 / 16.0  # of a channel: limits noise without loss of brightness
_MIN_ALBEDO = 1e-3
_LEAST_LIGHT = np.float32(1e-30)
_SOLID = 0.999  # opacity; texels with gaps are not comparable


def atlas_shade(atlas: Atlas, source: MeshSource) -> ShadingFn:
    """ShadingFn that reads baked luminance at the centroid of each fragment; opacity is the material's.

    Texture detail finer than the texels of the bake is restored (`texture_detail`). With colour in the atlas it shades
    in colour, with light of backs it shades both sides.

    Where the bake hit only gaps of a cut-out, the triangle's other texels are used; if there are none, the base colour
    under the mean light on its material. Raises SettingError if the atlas was laid out for another surface.
    """
    if len(atlas.charts.page) != source.triangle_count:
        raise SettingError(
            f"The baked light has {counted(len(atlas.charts.page), 'triangle')}, the surface {source.triangle_count}: "
            "bake the light again"
        )
    colored = atlas.texels.shape[1] == COLOR_CHANNELS
    table = TextureTable.from_materials(source.materials, color=colored)
    front = _light_of_side(atlas, source, table)
    back = front if atlas.back is None else _light_of_side(atlas.back, source, table)
    lit, back_share = atlas.lit, atlas.back_share

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, ...]:
        surface = surface_of_fragments(table, batch, fragments)
        if lit is None or back_share is None or atlas.back is None:
            light = front(batch, fragments, *surface)
            return (light[:, 0], surface[1], light[:, 1:]) if colored else (light[:, 0], surface[1])
        triangles = fragments.triangle.astype(np.int64) + batch.first_triangle
        lights = np.zeros((len(fragments), 2, 4 if colored else 1), np.float32)
        for side, light_of, other in ((0, front, -1), (1, back, 1)):
            own = np.flatnonzero(lit[triangles] != other)
            lights[own, side] = light_of(batch, fragments.only(own), *(values[own] for values in surface))
        light = _mean(lights, back_share[triangles][:, None])
        return light[:, 0], surface[1], light[:, 1:], lights

    return shade


def _mean(lights: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Light (F, C) of both sides (F, 2, C), blended with the share (F, 1) of the back."""
    luminance, hue = lights[..., :1], lights[..., 1:]
    scale = luminance / np.maximum(hue @ REC709[:, None], _LEAST_LIGHT) if hue.shape[-1] else luminance[..., :0]
    light = np.concatenate([luminance, hue * scale], axis=-1)
    return np.asarray((1.0 - share) * light[:, 0] + share * light[:, 1], np.float32)


_LightOfSide = Callable[[TriangleBatch, Fragments, np.ndarray, np.ndarray], np.ndarray]


def _light_of_side(atlas: Atlas, source: MeshSource, table: TextureTable) -> _LightOfSide:
    """Light (F, 1) of fragments with albedo (F,) and opacity (F,) on one side, or (F, 4) with colour."""
    channels = atlas.texels.shape[1]
    charts, texels = atlas.charts, atlas.texels
    if has_detail(table).any():  # base colours weighed by opacity, in further channels
        base = base_of_texels(atlas, source) if atlas.base is None else atlas.base
        texels = np.concatenate([texels, base * texels[:, 1:2]], axis=1)

    @functools.cache
    def irradiance() -> np.ndarray:
        return irradiance_of_materials(charts, texels, table, source, MIN_OPACITY)

    def light(batch: TriangleBatch, fragments: Fragments, albedo: np.ndarray, opacity: np.ndarray) -> np.ndarray:
        triangles = fragments.triangle.astype(np.int64) + batch.first_triangle
        values = lookup(charts, texels, triangles, fragments.barycentric)
        lost = (values[:, 1] <= MIN_OPACITY) & (opacity > 0.0)
        # At the edge of a cut-out, a texel may have hit only the gap.
        distinct, inverse = np.unique(triangles[lost], return_inverse=True)
        values[lost] = triangle_means(charts, texels, distinct)[inverse.reshape(-1)]
        seen = values[:, 1] > MIN_OPACITY
        values /= np.where(seen, values[:, 1], np.inf)[:, None]
        fine, held = detailed(table, batch, fragments, opacity), values[:, channels:]
        luminance = values[:, 0].copy()
        if len(fine):
            luminance[fine] *= texture_detail(albedo[fine], held[fine, 0])
        lost = ~seen & (opacity > 0.0)
        if lost.any():
            luminance[lost] = albedo[lost] * irradiance()[batch.materials[fragments.triangle[lost]]]
        if channels < COLOR_CHANNELS:
            return luminance[:, None]
        base = color_of_fragments(table, batch, fragments, np.ones(len(fragments), np.float32))
        hue = _rgb(values[:, 0], values[:, 2], values[:, 3])
        if len(fine):
            hue[fine] *= hue_detail(base[fine], _rgb(*held[fine].T))
        return np.concatenate([luminance[:, None], np.where(lost[:, None], base, hue)], axis=1)

    return light


def _rgb(luminance: np.ndarray, red: np.ndarray, blue: np.ndarray) -> np.ndarray:
    """Colours (n, 3) of a luminance (n,), red and blue; green follows from these."""
    green = np.maximum((luminance - np.float32(RED) * red - np.float32(BLUE) * blue) / np.float32(GREEN), 0.0)
    return np.stack([red, green, blue], axis=-1)


def has_detail(table: TextureTable) -> np.ndarray:
    """(M,) bool: materials with a texture that emit nothing."""
    known = table.materials
    return np.asarray(((known.chain >= 0) | (known.color_chain >= 0)) & (known.emission <= 0.0))


def detailed(table: TextureTable, batch: TriangleBatch, fragments: Fragments, opacity: np.ndarray) -> np.ndarray:
    """Indices (n,) of fragments with a texture, without gaps, that emit nothing."""
    return np.flatnonzero(has_detail(table)[batch.materials[fragments.triangle]] & (opacity >= _SOLID))


def texture_detail(albedo: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Factor (n,) on baked luminance of fragments with base luminance `albedo` (n,); 1 where texels held none.

    held: (n,), that of the texels around each.
    """
    return np.where(held > _MIN_ALBEDO, np.clip(albedo / np.maximum(held, _MIN_ALBEDO), 1.0 / _MAX, _MAX), 1.0)


def hue_detail(base: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Hue detail of baked light: factors (n, 3) on red, green and blue; brightness is ignored.

    base: (n, 3) base colours of luminance 1. held: (n, 3), of any luminance.
    """
    luminance = REC709[0] * held[:, 0] + REC709[1] * held[:, 1] + REC709[2] * held[:, 2]  # bit-identical in any order
    held = np.where(luminance[:, None] > _MIN_ALBEDO, held / np.maximum(luminance, _MIN_ALBEDO)[:, None], base)
    return np.clip(np.maximum(base, _MIN_ALBEDO) / np.maximum(held, _MIN_ALBEDO), _LEAST_HUE, _MAX)


def irradiance_of_materials(
    charts: Charts, texels: np.ndarray, table: TextureTable, source: MeshSource, min_opacity: float
) -> np.ndarray:
    """Baked luminance per luminance of base colour (M,) float64: means over all baked triangles.

    texels: (N, 2) float32, luminance weighed by opacity, and opacity. Triangles count by area, except those with at
    most `min_opacity`.
    """
    groups, lights, colors = [], [], []
    for batch in source.batches():
        means = triangle_means(charts, texels, np.arange(len(batch)) + batch.first_triangle)  # (T, 2)
        areas, _ = triangle_areas_and_normals(batch.corners_world)
        albedo, opacity = surface_of_fragments(table, batch, _whole(batch, areas))
        seen = (means[:, 1] > min_opacity) & (opacity > 0.0)  # without opacity there is no colour to compare
        groups.append(batch.materials[seen])
        lights.append(areas[seen] * np.maximum(means[seen, 0], 0.0))
        colors.append(areas[seen] * means[seen, 1] * albedo[seen])
    sums = [
        _exact_sums(np.concatenate(groups), np.concatenate(parts), len(source.materials)) for parts in (lights, colors)
    ]
    return np.divide(sums[0], sums[1], out=np.zeros_like(sums[0]), where=sums[1] > 0.0)


def _exact_sums(groups: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums (count,) float64 of values (n,) by their groups (n,), independent of order."""
    order = np.argsort(groups, kind="stable")
    parts = np.split(values[order], np.searchsorted(groups[order], np.arange(1, count)))
    return np.array([math.fsum(part) for part in parts])


def _whole(batch: TriangleBatch, areas: np.ndarray) -> Fragments:
    """Whole triangles, each as one fragment."""
    count = len(batch)
    centre = np.full((count, 2), 1.0 / 3.0, np.float32)
    return Fragments(np.zeros(count, np.uint64), np.arange(count, dtype=np.int32), centre, areas)
