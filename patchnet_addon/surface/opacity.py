# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity shading, only where there is surface: to find out what cameras see, before any light is known."""

from __future__ import annotations

import numpy as np

from .mesh import Fragments, MeshSource, ShadingFn, TriangleBatch
from .texture_lookup import surface_of_fragments
from .textures import TextureTable


def opacity_shade(source: MeshSource) -> ShadingFn:
    """Shading without luminance, by the very opacity of the lit surface; only cut-outs are looked up (methods 7.2a)."""
    table = TextureTable.from_materials(source.materials)
    cut_out = ~np.append(table.chains.solid.astype(bool), True)[table.materials.chain]  # the last: no texture

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, np.ndarray]:
        materials = batch.materials[fragments.triangle]
        opacity = table.materials.opacity[materials].astype(np.float32)
        chosen = np.flatnonzero(cut_out[materials])
        if len(chosen):
            part = _only(fragments, chosen)
            opacity[chosen] = surface_of_fragments(table, batch, part)[1]
        return np.zeros(len(fragments), np.float32), opacity

    return shade


def _only(fragments: Fragments, chosen: np.ndarray) -> Fragments:
    """Fragments at indices (n,)."""
    return Fragments(
        fragments.keys[chosen],
        fragments.triangle[chosen],
        fragments.barycentric[chosen],
        fragments.area_world[chosen],
        None if fragments.cut_keys is None else fragments.cut_keys[chosen],
        fragments.corners_voxel,
    )
