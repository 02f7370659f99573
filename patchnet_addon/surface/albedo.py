# SPDX-License-Identifier: GPL-3.0-or-later
"""Albedo shading, without light: the surface's own colour."""

from __future__ import annotations

import numpy as np

from .mesh import Fragments, MeshSource, ShadingFn, TriangleBatch
from .texture_color import color_of_fragments
from .texture_lookup import surface_of_fragments
from .textures import TextureTable


def albedo_shade(source: MeshSource, *, color: bool = False) -> ShadingFn:
    """ShadingFn whose luminance is that of base colour plus emission, and whose opacity is the material's."""
    table = TextureTable.from_materials(source.materials, color=color)

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, ...]:
        albedo, opacity = surface_of_fragments(table, batch, fragments)
        luminance = albedo + emission_of_fragments(table, batch, fragments)
        if not color:
            return luminance, opacity
        base = color_of_fragments(table, batch, fragments, albedo)
        return luminance, opacity, base + glow_of_fragments(table, batch, fragments)

    return shade


def emission_of_fragments(table: TextureTable, batch: TriangleBatch, fragments: Fragments) -> np.ndarray:
    """Emitted luminance (F,) float32."""
    return table.materials.emission[batch.materials[fragments.triangle]]


def glow_of_fragments(table: TextureTable, batch: TriangleBatch, fragments: Fragments) -> np.ndarray:
    """Emitted colour (F, 3) float32."""
    return table.materials.glow[batch.materials[fragments.triangle]]
