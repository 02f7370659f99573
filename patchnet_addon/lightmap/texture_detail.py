# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture detail finer than the texels of a bake, put back onto baked light.

Light that falls on a surface changes slowly, its texture does not. A bake holds their product, blurred to its texels.
So a fragment gets the baked value times its own base colour over the base colour that the texel held: irradiance at
the resolution of the bake, texture at that of the voxels (methods 7.2c).
"""

from __future__ import annotations

import numpy as np

from ..surface.mesh import Fragments, TriangleBatch
from ..surface.texture_color import color_of_fragments
from ..surface.texture_lookup import surface_of_fragments
from ..surface.textures import TextureTable
from .charts import Charts
from .packing import SINGLE

_MAX = 4.0  # what texture can do to light, either way: beyond it the two base colours are not of one texel
_MIN_ALBEDO = 1e-3
_SOLID = 0.999  # opacity; with gaps in them, texels hold light of their own kind


def texture_detail(
    charts: Charts,
    table: TextureTable,
    batch: TriangleBatch,
    fragments: Fragments,
    albedo: np.ndarray,
    opacity: np.ndarray,
) -> np.ndarray:
    """Factor (F,) float32 on the baked light of fragments: 1 without texture, for gaps and for what emits.

    albedo, opacity: (F,) of the fragments, by `surface_of_fragments`.
    """
    factor = np.ones(len(fragments), np.float32)
    chosen = _textured(table, batch, fragments, opacity)
    if not len(chosen):
        return factor
    held, covered = surface_of_fragments(table, batch, _at_texels(charts, batch, fragments, chosen))
    known = (held > _MIN_ALBEDO) & (covered >= _SOLID)
    ratio = albedo[chosen[known]] / held[known]
    factor[chosen[known]] = np.clip(ratio, 1.0 / _MAX, _MAX)
    return factor


def hue_detail(
    charts: Charts,
    table: TextureTable,
    batch: TriangleBatch,
    fragments: Fragments,
    base: np.ndarray,
    opacity: np.ndarray,
) -> np.ndarray:
    """Hue detail of baked light: factors (F, 3) float32 on red, green and blue; brightness does not count.

    base: (F, 3) base colours of luminance 1, by `color_of_fragments`. opacity: (F,).
    """
    factor = np.ones((len(fragments), 3), np.float32)
    chosen = _textured(table, batch, fragments, opacity)
    if len(chosen):
        texels = _at_texels(charts, batch, fragments, chosen)
        held = color_of_fragments(table, batch, texels, np.ones(len(chosen), np.float32))
        ratio = np.maximum(base[chosen], _MIN_ALBEDO) / np.maximum(held, _MIN_ALBEDO)
        factor[chosen] = np.clip(ratio, 1.0 / _MAX, _MAX)
    return factor


def _textured(table: TextureTable, batch: TriangleBatch, fragments: Fragments, opacity: np.ndarray) -> np.ndarray:
    """Indices (n,) of fragments with a texture, without gaps, that emit nothing."""
    materials, known = batch.materials[fragments.triangle], table.materials
    plain = (known.chain[materials] < 0) | (known.emission[materials] > 0.0) | (opacity < _SOLID)
    return np.flatnonzero(~plain)


def _at_texels(charts: Charts, batch: TriangleBatch, fragments: Fragments, chosen: np.ndarray) -> Fragments:
    """Chosen fragments (n,), each as large as a texel of the bake."""
    triangles = fragments.triangle[chosen]
    areas = _texel_areas(charts, batch, triangles)
    return Fragments(fragments.keys[chosen], triangles, fragments.barycentric[chosen], areas)


def _texel_areas(charts: Charts, batch: TriangleBatch, triangles: np.ndarray) -> np.ndarray:
    """Area (F,) float64, world units, of one texel on each of the batch's triangles (F,)."""
    if not len(triangles):
        return np.empty(0)
    first, last = int(triangles.min()), int(triangles.max()) + 1
    corners = batch.corners_world[first:last]
    edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * np.linalg.norm(np.cross(*edges), axis=1)
    numbers = slice(batch.first_triangle + first, batch.first_triangle + last)
    logs = charts.log_width[numbers].astype(np.float64) + charts.log_height[numbers]
    texels = np.where(charts.kind[numbers] == SINGLE, 1.0, np.exp2(logs) / 2.0)
    return (areas / np.maximum(texels, 1.0))[triangles - first]
