# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures for rays that end on triangles: the mip chains of a `TextureTable` in four bytes a texel (methods 7.2k)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .textures import LEVEL_BIAS, TextureTable

TOP = 255.0
# Columns of a triangle's numbers in `Pieces.uvs`: u and v of each corner; level of detail; material.
U, V, DETAIL, MATERIAL_OF = 0, 1, 6, 7
# A mip chain: its first level, their number, wrap mode and transform, as in `MipChains`; level of a footprint that
# covers the unit square of UV coordinates.
CHAIN = np.dtype(
    [("first", "<i4"), ("level_count", "<i4"), ("wrap", "<i4"), ("transform", "<f4", (2, 3)), ("detail", "<f4")]
)
# A material: chain and color_chain as in `MaterialTable`; linear colour without texture, gray without colour; opacity
# and threshold; whether colour multiplies light, and whether it is not opaque everywhere; clear_side as there.
MATERIAL = np.dtype(
    [("chain", "<i4"), ("color_chain", "<i4"), ("red", "<f4"), ("green", "<f4"), ("blue", "<f4")]
    + [("opacity", "<f4"), ("threshold", "<f4"), ("reflects", "<i4"), ("holes", "<i4"), ("clear_side", "<i4")]
)


class HitTextures(NamedTuple):
    """Textures for rays: M materials, K chains of V levels, N texels; few arrays, since kernels pass them on by rays.

    texels: (N,) uint32, a byte each, lowest first, for the roots of red, green and blue times opacity, and opacity, 255
    = 1. levels: (V, 3) int64, as `MipChains`. chains: (K,) CHAIN. materials: (M,) MATERIAL.
    """

    texels: np.ndarray
    levels: np.ndarray
    chains: np.ndarray
    materials: np.ndarray


NO_TEXTURES = HitTextures(np.empty(0, np.uint32), np.empty((0, 3), np.int64), np.empty(0, CHAIN), np.empty(0, MATERIAL))


def hit_textures(table: TextureTable, reflects: np.ndarray, *, color: bool) -> HitTextures:
    """Textures for rays of a table, which has colour if `color`. reflects: (M,) bool."""
    texels = np.empty((len(table.chains.texels), 4), np.uint8)
    for first in range(0, len(texels), 1 << 20):  # so that no second table of floats is in memory
        part = slice(first, first + (1 << 20))
        colors = table.chains.colors[part] if color else table.chains.texels[part, :1]
        texels[part, :3] = np.rint(TOP * np.sqrt(np.clip(colors, 0.0, 1.0)))
        texels[part, 3] = np.rint(TOP * np.clip(table.chains.texels[part, 1], 0.0, 1.0))
    return HitTextures(
        texels.view("<u4")[:, 0], table.chains.levels, _chains(table), _materials(table, reflects, color=color)
    )


def _chains(table: TextureTable) -> np.ndarray:
    """Chains (K,) CHAIN of a table."""
    given = table.chains
    chains = np.empty(len(given.first), CHAIN)
    for name in ("first", "level_count", "wrap", "transform"):
        chains[name] = getattr(given, name)
    finest = given.levels[given.first]
    covered = np.abs(np.linalg.det(given.transform[:, :, :2])) * (finest[:, 1] * finest[:, 2])  # texels
    chains["detail"] = 0.5 * np.log2(np.maximum(covered, 1e-12)) - LEVEL_BIAS
    return chains


def _materials(table: TextureTable, reflects: np.ndarray, *, color: bool) -> np.ndarray:
    """Materials (M,) MATERIAL of a table."""
    given = table.materials
    materials = np.empty(len(given.chain), MATERIAL)
    for name in ("chain", "color_chain", "opacity", "threshold", "clear_side"):
        materials[name] = getattr(given, name)
    for channel, name in enumerate(("red", "green", "blue")):
        materials[name] = given.base_color[:, channel] if color else given.luminance
    solid = np.append(table.chains.solid, True)[given.chain]  # the last: no texture
    materials["reflects"], materials["holes"] = reflects, ~solid | (given.opacity < 1.0) | (given.clear_side >= 0)
    return materials
