# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of `texture_color`: one fragment after the other."""

from __future__ import annotations

import numpy as np

from .chroma import BLUE, GREEN, RED
from .footprint_reference import bilinear_reference
from .mesh import Fragments, TriangleBatch
from .textures import EXTENSIONS, TextureTable

_NAMES = {number: name for name, number in EXTENSIONS.items()}


def colors_reference(
    table: TextureTable, batch: TriangleBatch, fragments: Fragments, luminance: np.ndarray
) -> np.ndarray:
    """Base colours (F, 3) of fragments with the given luminance (F,)."""
    hues = np.array([_hue(table, batch, fragments, index) for index in range(len(fragments))])
    own = hues @ (RED, GREEN, BLUE)
    scaled = hues * (luminance / np.where(own > 0.0, own, 1.0))[:, None]
    return np.where(own[:, None] > 0.0, scaled, luminance[:, None])


def _hue(table: TextureTable, batch: TriangleBatch, fragments: Fragments, index: int) -> np.ndarray:
    """Colour (3,) of any brightness."""
    triangle = int(fragments.triangle[index])
    material = batch.materials[triangle]
    pyramid = max(int(table.material_color[material]), -1)
    pyramid = pyramid if pyramid >= 0 else int(table.material_pyramid[material])
    if pyramid < 0:
        return table.material_base[material].astype(float)
    b1, b2 = fragments.barycentric[index].astype(float)
    uvs = batch.uvs[triangle].astype(float)
    matrix = table.pyramid_transform[pyramid]
    point = matrix @ [*(np.array([1 - b1 - b2, b1, b2]) @ uvs), 1.0]
    on_image = uvs @ matrix[:, :2].T
    first, count = int(table.pyramid_first[pyramid]), int(table.pyramid_levels[pyramid])
    texels = _area(on_image) * table.level_height[first] * table.level_width[first]
    share = fragments.area_world[index] / _area(batch.corners_world[triangle])
    level = np.clip(0.5 * np.log2(max(texels * share, 1e-12)) - 0.5 * np.log2(3.0), 0, count - 1)
    extension = _NAMES[int(table.pyramid_extension[pyramid])]
    fine, weight = int(level), level - int(level)
    mixed = np.zeros(3)
    while fine < count and mixed.sum() <= 0.0:
        near, far = (
            bilinear_reference(_raster(table, first + at), point[None], extension)[0]
            for at in (fine, min(fine + 1, count - 1))
        )
        mixed = near + weight * (far - near)
        fine += 1
    return mixed


def _raster(table: TextureTable, level: int) -> np.ndarray:
    height, width = int(table.level_height[level]), int(table.level_width[level])
    offset = int(table.level_offset[level])
    return table.colors[offset : offset + height * width].reshape(height, width, 3)


def _area(corners: np.ndarray) -> float:
    """Area of a triangle (3, 2 or 3)."""
    a, b = np.pad(corners[1:] - corners[0], ((0, 0), (0, 3 - corners.shape[1])))
    return 0.5 * float(np.linalg.norm(np.cross(a, b)))
