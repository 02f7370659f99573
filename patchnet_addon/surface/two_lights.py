# SPDX-License-Identifier: GPL-3.0-or-later
"""Two Lights, the paper's light: two antipodal directional lights without shadows (methods 7.3)."""

from __future__ import annotations

import numpy as np

from ..runtime.errors import SettingError
from .albedo import emission_of_fragments, glow_of_fragments
from .mesh import Fragments, MeshSource, ShadingFn, TriangleBatch
from .texture_color import color_of_fragments
from .texture_lookup import surface_of_fragments
from .textures import TextureTable

# A unit vector along no axis, so that the faces of a box differ.
DIRECTION = (0.36, -0.48, 0.8)


def two_lights_shade(
    source: MeshSource, direction: tuple[float, float, float] = DIRECTION, *, color: bool = False
) -> ShadingFn:
    """ShadingFn with luminance albedo * |normal . direction| + emission; both sides of a surface are lit alike.

    Raises SettingError if the direction is zero or not finite.
    """
    towards = np.asarray(direction, np.float64)
    length = float(np.linalg.norm(towards))
    if not (np.isfinite(length) and length > 0.0):
        raise SettingError(f"Light direction {tuple(direction)} is no direction: give a vector that is not zero")
    towards /= length
    table = TextureTable.from_materials(source.materials, color=color)

    def shade(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, ...]:
        albedo, opacity = surface_of_fragments(table, batch, fragments)
        cosine = _cosines(batch, fragments, towards)
        luminance = albedo * cosine + emission_of_fragments(table, batch, fragments)
        if not color:
            return luminance, opacity
        base = color_of_fragments(table, batch, fragments, albedo * cosine)
        return luminance, opacity, base + glow_of_fragments(table, batch, fragments)

    return shade


def _cosines(batch: TriangleBatch, fragments: Fragments, towards: np.ndarray) -> np.ndarray:
    """|n . d| (F,) float32; fragments name triangles in ascending order, so only those between are computed."""
    if not len(fragments):
        return np.empty(0, np.float32)
    first, last = int(fragments.triangle.min()), int(fragments.triangle.max()) + 1
    corners = batch.corners_world[first:last]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    # Column by column: a product of matrices rounds differently with its size, and so with the order of triangles.
    cosine = np.abs(sum(normals[:, axis] * towards[axis] for axis in range(3))) / length
    return cosine.astype(np.float32)[fragments.triangle - first]
