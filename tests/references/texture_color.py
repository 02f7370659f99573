# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of `color_of_fragments`, fragment by fragment."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.surface.chroma import BLUE, GREEN, RED
from patchnet.patchnet_addon.surface.mesh import Fragments, TriangleBatch
from patchnet.patchnet_addon.surface.textures import WRAP_MODES, MipChains, TextureTable
from patchnet.tests.references.footprint import bilinear_reference

_NAMES = {number: name for name, number in WRAP_MODES.items()}


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
    chains, materials = table.chains, table.materials
    chain = int(materials.color_chain[material])
    chain = chain if chain >= 0 else int(materials.chain[material])
    if chain < 0:
        return materials.base_color[material].astype(float)
    b1, b2 = fragments.barycentric[index].astype(float)
    uvs = batch.uvs[triangle].astype(float)
    matrix = chains.transform[chain]
    point = matrix @ [*(np.array([1 - b1 - b2, b1, b2]) @ uvs), 1.0]
    on_image = uvs @ matrix[:, :2].T
    first, count = int(chains.first[chain]), int(chains.level_count[chain])
    texels = _area(on_image) * chains.levels[first, 1:].prod()
    share = fragments.area_world[index] / _area(batch.corners_world[triangle])
    level = np.clip(0.5 * np.log2(max(texels * share, 1e-12)) - 0.5 * np.log2(3.0), 0, count - 1)
    wrap = _NAMES[int(chains.wrap[chain])]
    fine, weight = int(level), level - int(level)
    mixed = np.zeros(3)
    while fine < count and mixed.sum() <= 0.0:
        near, far = (
            bilinear_reference(_raster(chains, first + at), point[None], wrap)[0]
            for at in (fine, min(fine + 1, count - 1))
        )
        mixed = near + weight * (far - near)
        fine += 1
    return mixed


def _raster(chains: MipChains, level: int) -> np.ndarray:
    offset, height, width = chains.levels[level]
    return chains.colors[offset : offset + height * width].reshape(height, width, 3)


def _area(corners: np.ndarray) -> float:
    """Area of a triangle (3, 2 or 3)."""
    a, b = np.pad(corners[1:] - corners[0], ((0, 0), (0, 3 - corners.shape[1])))
    return 0.5 * float(np.linalg.norm(np.cross(a, b)))
