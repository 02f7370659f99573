# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colours of texels, means over where the texel's paths go out from (methods 7.2g).

What is left of a texture after its base colour is divided out would be noise that two halves of a bake share.
"""

from __future__ import annotations

import numpy as np

from ..surface.mesh import Fragments, TriangleBatch
from ..surface.texture_color import color_of_fragments
from ..surface.texture_lookup import surface_of_fragments
from ..surface.textures import TextureTable
from .texel_places import BatchTexels, texel_places

_PLACES = 4  # along a texel's side, in which its base colour is looked up where that has a texture
_AT_ONCE = 1 << 16  # texels whose places are in memory together
_EMPTY = 1e-6  # weight of a gap: where all is gap, its colour counts nevertheless


def base_colors(
    table: TextureTable, batch: TriangleBatch, own: BatchTexels, area: np.ndarray, *, spread: float, colored: bool
) -> np.ndarray:
    """Base colour (n, 1) float32 of luminance, or (n, 3) of luminance, red, blue, of texels.

    area: (n,) of each texel, in world units. spread: side of the square around a texel's centre that its paths go out
    from, in texels.
    """
    found = np.empty((len(own), 3 if colored else 1), np.float32)
    materials = batch.materials[own.triangles]
    textured = (table.materials.chain[materials] >= 0) | (table.materials.color_chain[materials] >= 0)
    found[~textured] = _plain(table, batch, colored)[materials[~textured]]
    left = np.flatnonzero(textured)
    for first in range(0, len(left), _AT_ONCE):
        part = left[first : first + _AT_ONCE]
        share = area[part] * (spread / _PLACES) ** 2
        found[part] = _means(table, batch, own.only(part), share, spread, colored)
    return found


def _plain(table: TextureTable, batch: TriangleBatch, colored: bool) -> np.ndarray:
    """Base colours (M, 1 or 3) of all materials of a table, those of the batch that have no texture among them."""
    used, first = np.unique(batch.materials, return_index=True)
    points = Fragments(
        np.zeros(len(used), np.uint64), first.astype(np.int32), np.zeros((len(used), 2), np.float32), np.ones(len(used))
    )
    found = np.zeros((len(table.materials.luminance), 3 if colored else 1), np.float32)
    found[used], _ = _colors(table, batch, points, colored)
    return found


def _means(
    table: TextureTable, batch: TriangleBatch, own: BatchTexels, share: np.ndarray, spread: float, colored: bool
) -> np.ndarray:
    """Mean base colours (n, 1 or 3) over places in texels, each with an area `share` (n,)."""
    places = texel_places(own, side=_PLACES, spread=spread)
    count, each, _ = places.shape
    pieces = Fragments(
        np.zeros(count * each, np.uint64), np.repeat(own.triangles.astype(np.int32), each), places.reshape(-1, 2),
        np.repeat(share, each),
    )  # fmt: skip
    color, opacity = _colors(table, batch, pieces, colored)
    weight = opacity.reshape(count, each).astype(np.float64) + _EMPTY
    total = np.einsum("nkc,nk->nc", color.reshape(count, each, -1), weight)
    return np.asarray(total / weight.sum(axis=1, keepdims=True))


def _colors(
    table: TextureTable, batch: TriangleBatch, pieces: Fragments, colored: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Base colour, luminance (n, 1) or luminance, red, blue (n, 3), and opacity (n,)."""
    luminance, opacity = surface_of_fragments(table, batch, pieces)
    if not colored:
        return luminance[:, None], opacity
    color = color_of_fragments(table, batch, pieces, luminance)
    return np.stack([luminance, color[:, 0], color[:, 2]], axis=1), opacity
