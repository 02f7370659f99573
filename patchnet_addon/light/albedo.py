# SPDX-License-Identifier: GPL-3.0-or-later
"""Shading without light: the surface's own colour."""

from __future__ import annotations

import numpy as np

from ..octree.mesh import Fragments, MeshSource, Shade, TriangleBatch
from .texture_lookup import surface_of_fragments
from .textures import TextureTable


def albedo_shade(source: MeshSource) -> Shade:
    """Shade whose luminance is that of base colour plus emission, and whose opacity is the material's."""
    table = TextureTable.from_materials(source.materials)

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, np.ndarray]:
        albedo, opacity = surface_of_fragments(table, batch, fragments)
        return albedo + emission_of_fragments(table, batch, fragments), opacity

    return shade


def emission_of_fragments(table: TextureTable, batch: TriangleBatch, fragments: Fragments) -> np.ndarray:
    """Emitted luminance (F,) float32."""
    return table.material_emission[batch.materials[fragments.triangle]]
