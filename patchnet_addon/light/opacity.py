# SPDX-License-Identifier: GPL-3.0-or-later
"""Shading that only says where there is surface: to find out what cameras see, before any light is known."""

from __future__ import annotations

import numpy as np

from ..octree.mesh import Fragments, MeshSource, Shade, TriangleBatch
from .texture_lookup import surface_of_fragments
from .textures import TextureTable


def opacity_shade(source: MeshSource) -> Shade:
    """Shade without luminance. Cut-outs are looked up once per fragment, not integrated over its outline, which takes
    several times as long and moves the edge of a gap by less than a fragment."""
    table = TextureTable.from_materials(source.materials)
    cut_out = ~np.append(table.pyramid_solid.astype(bool), True)[table.material_pyramid]  # the last: no texture

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, np.ndarray]:
        materials = batch.materials[fragments.triangle]
        opacity = table.material_opacity[materials].astype(np.float32)
        chosen = np.flatnonzero(cut_out[materials])
        if len(chosen):
            part = Fragments(*(column[chosen] for column in _columns(fragments)))
            opacity[chosen] = surface_of_fragments(table, batch, part)[1]
        return np.zeros(len(fragments), np.float32), opacity

    return shade


def _columns(fragments: Fragments) -> tuple[np.ndarray, ...]:
    """What the look-up at centroids takes."""
    return fragments.keys, fragments.triangle, fragments.barycentric, fragments.area_world
