# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain references of the light map: base colours, denoising, sample places in texels."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.lightmap.denoised_atlas import (
    _AGREES,
    _CROSSING,
    _HIGH,
    _LOW,
    _MOST_BETWEEN,
    _SIGMAS,
    _WIDE,
    MOST_IN_CELL,
    MOST_WALLS,
    REACH,
    Cells,
    Texels,
)
from patchnet.patchnet_addon.lightmap.texel_bases import _EMPTY, _PLACES, BatchTexels
from patchnet.patchnet_addon.surface.mesh import Fragments, TriangleBatch
from patchnet.patchnet_addon.surface.texture_lookup import color_of_fragments, surface_of_fragments
from patchnet.patchnet_addon.surface.textures import TextureTable


def _colors(
    table: TextureTable, batch: TriangleBatch, pieces: Fragments, colored: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Base colour, luminance (n, 1) or luminance, red, blue (n, 3), and opacity (n,)."""
    luminance, opacity = surface_of_fragments(table, batch, pieces)
    if not colored:
        return luminance[:, None], opacity
    color = color_of_fragments(table, batch, pieces, luminance)
    return np.stack([luminance, color[:, 0], color[:, 2]], axis=1), opacity


def base_colors_reference(
    table: TextureTable, batch: TriangleBatch, own: BatchTexels, area: np.ndarray, *, spread: float, colored: bool
) -> np.ndarray:
    """Reference of `base_colors` by one fragment lookup per place."""
    places = texel_places_reference(own, side=_PLACES, spread=spread)
    count, each, _ = places.shape
    share = np.repeat(area * (spread / _PLACES) ** 2, each)
    triangles = np.repeat(own.triangles.astype(np.int32), each)
    pieces = Fragments(np.zeros(count * each, np.uint64), triangles, places.reshape(-1, 2), share)
    color, opacity = _colors(table, batch, pieces, colored)
    weight = opacity.reshape(count, each).astype(np.float64) + _EMPTY
    total = np.einsum("nkc,nk->nc", color.reshape(count, each, -1), weight)
    return np.asarray(total / weight.sum(axis=1, keepdims=True))


def denoise_reference(texels: Texels, cells: Cells) -> np.ndarray:
    """Reference of `denoise` in NumPy, texel by texel: (N, C)."""
    guide = _filtered_reference(texels, cells, None, REACH / 2.0)
    return _filtered_reference(texels, cells, guide, REACH)[:, 1:]


def _filtered_reference(texels: Texels, cells: Cells, guide: np.ndarray | None, reach: float) -> np.ndarray:
    """Variance and light (N, 1 + C) of one pass."""
    out = np.empty((len(texels.size), 1 + texels.light.shape[1]))
    for cell in range(len(cells.around)):
        near = [np.arange(cells.first[c], cells.first[c + 1]) for c in cells.around[cell] if c >= 0]
        others, walls = (
            np.concatenate([part[:: -(-len(part) // most)] for part in near]) for most in (MOST_IN_CELL, MOST_WALLS)
        )
        for p in range(cells.first[cell], cells.first[cell + 1]):
            q = np.append(others[others != p], p)
            between = _between_reference(texels, reach, p, walls[walls != p])
            weight = _weights_reference(texels, guide, reach, between, p, q)
            out[p, 0] = (weight**2 * texels.variance[q]).sum() / weight.sum() ** 2
            if guide is None:  # mean variance of the neighbours: one texel's own estimate is unreliable
                out[p, 0] = (weight * texels.variance[q]).sum() / weight.sum() * (weight**2).sum() / weight.sum() ** 2
            out[p, 1:] = (weight[:, None] * texels.light[q]).sum(axis=0) / weight.sum()
    return out


def _between_reference(texels: Texels, reach: float, p: int, q: np.ndarray) -> np.ndarray:
    """Points (b, 3), relative to p, of texels q (n,) on other surfaces that cross the plane of p."""
    size, normal = float(texels.size[p]), texels.normals[p].astype(np.float64)
    apart = texels.points[q].astype(np.float64) - texels.points[p]
    height, cosine = apart @ normal, texels.normals[q].astype(np.float64) @ normal
    crossing = (np.abs(cosine) < _CROSSING) & (height > _LOW * size) & (height < _HIGH * size)
    return np.asarray(apart[crossing & ((apart**2).sum(axis=1) <= (reach * size) ** 2)][:_MOST_BETWEEN])


def _weights_reference(
    texels: Texels, guide: np.ndarray | None, reach: float, between: np.ndarray, p: int, q: np.ndarray
) -> np.ndarray:
    """Weights (n,) of texels q (n,) in the mean of texel p; `between` (b, 3): points of surfaces in between."""
    size, normal = float(texels.size[p]), texels.normals[p].astype(np.float64)
    apart = texels.points[q].astype(np.float64) - texels.points[p]
    height = apart @ normal
    cosine = texels.normals[q].astype(np.float64) @ normal
    distance = np.sqrt((apart**2).sum(axis=1))
    weight = np.exp(-2.0 * (distance / (reach * size)) ** 2) * texels.weight[q] * np.maximum(cosine, 0.0) ** 8
    good = (texels.material[q] == texels.material[p]) & (cosine >= _AGREES) & (distance <= reach * size)
    good &= np.abs(height) <= 0.3 * size + 0.15 * distance
    for b in between:
        flat = apart - height[:, None] * normal
        length = np.sqrt((flat**2).sum(axis=1))
        along = flat @ b / np.maximum(length, 1e-30)
        side = b - (b @ normal) * normal
        across = np.sqrt(np.maximum(side @ side - along**2, 0.0))
        good &= ~((along > 0.0) & (along < length) & (across < _WIDE * size))
    if guide is not None:
        difference = (guide[q, 1] - guide[p, 1]) ** 2
        noise = guide[q, 0] + guide[p, 0]
        weight = weight * np.exp(-difference / np.maximum(2.0 * _SIGMAS**2 * noise, 1e-30))
    return np.where(good | (q == p), weight, 0.0)


def texel_places_reference(own: BatchTexels, *, side: int = 1, spread: float = 1.0) -> np.ndarray:
    """Reference of `texel_centres`, and places of `base_colors`, in NumPy."""
    row, column = np.divmod(own.texels % own.page_side**2, own.page_side)
    corners = own.corners[own.triangles]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    found = np.empty((len(own), side * side, 2), np.float32)
    for number, steps in enumerate(np.ndindex(side, side)):
        at = 0.5 + ((np.array(steps) + 0.5) / side - 0.5) * spread
        place = np.stack([column, row], axis=1) + at - corners[:, 0]
        first = (place[:, 0] * two[:, 1] - place[:, 1] * two[:, 0]) / area
        second = (one[:, 0] * place[:, 1] - one[:, 1] * place[:, 0]) / area
        weights = np.maximum(np.stack([first, second], axis=1), 0.0)
        found[:, number] = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
    return found
