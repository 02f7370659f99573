# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture detail finer than the texels of a bake, put back onto baked light.

Light that falls on a surface changes slowly, its texture does not. A bake holds their product, blurred to its texels.
So a fragment gets the baked value times its own base colour over the base colour that the texels around it were baked
with: irradiance at the resolution of the bake, texture at that of the voxels (methods 7.2c).
"""

from __future__ import annotations

import numpy as np

from ..surface.chroma import REC709
from ..surface.mesh import Fragments, TriangleBatch
from ..surface.textures import TextureTable

_MAX = 4.0  # what texture can do to light, either way: beyond it the two base colours are not of one texel
_LEAST_HUE = 1.0 / 16.0  # of a channel: what it loses is no brightness, and no noise grows
_MIN_ALBEDO = 1e-3
_SOLID = 0.999  # opacity; with gaps in them, texels hold light of their own kind


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
    """Hue detail of baked light: factors (n, 3) on red, green and blue; brightness does not count.

    base: (n, 3) base colours of luminance 1. held: (n, 3), of any luminance.
    """
    luminance = REC709[0] * held[:, 0] + REC709[1] * held[:, 1] + REC709[2] * held[:, 2]  # the same bits in any order
    held = np.where(luminance[:, None] > _MIN_ALBEDO, held / np.maximum(luminance, _MIN_ALBEDO)[:, None], base)
    return np.clip(np.maximum(base, _MIN_ALBEDO) / np.maximum(held, _MIN_ALBEDO), _LEAST_HUE, _MAX)
