# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colours of texels, means over the area of each texel's paths (methods 7.2g).

Baked light is divided by them before denoising; any texture left in it would be noise that both halves of a bake share.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.mesh import Fragments, TriangleBatch
from ..surface.texels import MipChain, on_texture
from ..surface.texture_color import color_of_fragments, trilinear_color
from ..surface.texture_lookup import level_of_size, surface_of_fragments, trilinear_luminance, uv_at
from ..surface.textures import TextureTable
from .texel_places import BatchTexels, place_in_texel, texel_frame

_PLACES = 4  # lookups along a texel's side, for textured base colours
_EMPTY = 1e-6  # weight of a transparent part: a fully transparent texel still has a colour


def base_colors(
    table: TextureTable, batch: TriangleBatch, own: BatchTexels, area: np.ndarray, *, spread: float, colored: bool
) -> np.ndarray:
    """Base colour (n, 1) float32 of luminance, or (n, 3) of luminance, red, blue, of texels.

    area: (n,) of each texel, in world units. spread: side in texels of the square around a texel's centre with the
    origins of its paths.
    """
    found = np.empty((len(own), 3 if colored else 1), np.float32)
    materials = batch.materials[own.triangles]
    textured = table.materials.chain[materials] >= 0
    found[~textured] = _plain(table, batch, colored)[materials[~textured]]
    left = np.flatnonzero(textured)
    share = area[left] * (spread / _PLACES) ** 2
    texels = own.texels[left], own.triangles[left], own.corners, own.page_side, share, float(spread)
    means = np.empty((len(left), found.shape[1]), np.float32)
    run_parts(_means, len(left), texels, batch.arrays, table.chains, table.materials, means)
    found[left] = means
    return found


def _plain(table: TextureTable, batch: TriangleBatch, colored: bool) -> np.ndarray:
    """Base colours (M, 1 or 3) of all materials of a table, exact for those without texture."""
    used, first = np.unique(batch.materials, return_index=True)
    points = Fragments(
        np.zeros(len(used), np.uint64), first.astype(np.int32), np.zeros((len(used), 2), np.float32), np.ones(len(used))
    )
    found = np.zeros((len(table.materials.luminance), 3 if colored else 1), np.float32)
    found[used], _ = _colors(table, batch, points, colored)
    return found


def _colors(
    table: TextureTable, batch: TriangleBatch, pieces: Fragments, colored: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Base colour, luminance (n, 1) or luminance, red, blue (n, 3), and opacity (n,)."""
    luminance, opacity = surface_of_fragments(table, batch, pieces)
    if not colored:
        return luminance[:, None], opacity
    color = color_of_fragments(table, batch, pieces, luminance)
    return np.stack([luminance, color[:, 0], color[:, 2]], axis=1), opacity


@device
def _hue(colors, levels, chain, level, u, v):  # type: ignore[no-untyped-def]
    """Red and blue of luminance 1, searched farther around transparent parts; 1 for black."""
    red, green, blue = trilinear_color(colors, levels, chain, level, u, v)
    while red + green + blue <= 0.0 and level + 1.0 <= chain.level_count - 1:
        level += 1.0
        red, green, blue = trilinear_color(colors, levels, chain, level, u, v)
    own = RED * red + GREEN * green + BLUE * blue
    return (red / own, blue / own) if own > 0.0 else (1.0, 1.0)


@kernel
def _means(first, last, texels, triangles, chains, materials, out):  # type: ignore[no-untyped-def]
    """Write mean base colours over the places in textured texels, each with an area `share`."""
    texel, triangle, page_corners, page_side, share, spread = texels
    values, colors, levels, transform = chains.texels, chains.colors, chains.levels, chains.transform
    colored = out.shape[1] > 1
    for index in range(first, last):
        t = triangle[index]
        material = triangles.materials[t]
        corners, uvs = triangles.corners_world[t], triangles.uvs[t]
        k = materials.chain[material]
        c = materials.color_chain[material] if materials.color_chain[material] >= 0 else k
        chain = MipChain(chains.first[k], chains.level_count[k], chains.wrap[k])
        color_chain = MipChain(chains.first[c], chains.level_count[c], chains.wrap[c])
        level = level_of_size(levels, chain, transform[k], corners, uvs, share[index])
        color_level = level if c == k else level_of_size(levels, color_chain, transform[c], corners, uvs, share[index])
        plain = materials.opacity[material]
        threshold = materials.threshold[material] / plain
        frame = texel_frame(texel[index], page_corners[t], page_side)
        total, total_red, total_blue, weights = 0.0, 0.0, 0.0, 0.0
        for place in range(_PLACES * _PLACES):
            s, r = uv_at(uvs, place_in_texel(frame, place // _PLACES, place % _PLACES, _PLACES, spread))
            u, v = on_texture(transform[k], s, r)
            premultiplied, opacity = trilinear_luminance(values, levels, chain, level, threshold, u, v)
            around = opacity
            if c != k:
                u, v = on_texture(transform[c], s, r)
                premultiplied, around = trilinear_luminance(values, levels, color_chain, color_level, math.nan, u, v)
            luminance = premultiplied / around if around > 1e-6 else 0.0
            if math.isnan(threshold):
                opacity *= plain
            weight = min(opacity, 1.0) + _EMPTY
            weights += weight
            total += weight * luminance
            if colored and luminance > 0.0:
                red, blue = _hue(colors, levels, color_chain, color_level, u, v)
                total_red += weight * luminance * red
                total_blue += weight * luminance * blue
        out[index, 0] = total / weights
        if colored:
            out[index, 1] = total_red / weights
            out[index, 2] = total_blue / weights
