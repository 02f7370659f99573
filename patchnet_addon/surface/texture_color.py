# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colour of fragments, beside the luminance of `texture_lookup` (methods 7.2d).

Only the hue is looked up here, at the centroid and averaged over the fragment's size, or a larger area if that is only
a gap. It is then scaled to the luminance, so that opacity and luminance have one source, with and without colour.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .chroma import BLUE, GREEN, RED
from .mesh import Fragments, TriangleBatch
from .texels import MipChain, mip_level, on_texture, wrapped
from .texture_lookup import level_of_size, uv_at
from .textures import TextureTable


def color_of_fragments(
    table: TextureTable, batch: TriangleBatch, fragments: Fragments, luminance: np.ndarray
) -> np.ndarray:
    """Linear base colour (F, 3) float32 of fragments with the given luminance (F,); gray if the material is black.

    The table must have colour.
    """
    out = np.empty((len(fragments), 3), np.float32)
    given = np.asarray(luminance, np.float32)
    run_parts(_colors, len(fragments), batch.arrays, fragments.arrays, table.chains, table.materials, given, out)
    return out


@device
def _bilinear(colors, level, u, v):  # type: ignore[no-untyped-def]
    """Opacity * red, green, blue at (u, v) in units of the texture."""
    x = u * level.width - 0.5
    y = v * level.height - 0.5
    left = math.floor(x)
    low = math.floor(y)
    red = 0.0
    green = 0.0
    blue = 0.0
    for dy in range(2):
        row = wrapped(int(low) + dy, level.height, level.wrap)
        weight_y = y - low if dy else 1.0 - (y - low)
        for dx in range(2):
            column = wrapped(int(left) + dx, level.width, level.wrap)
            if row < 0 or column < 0:
                continue
            weight = weight_y * (x - left if dx else 1.0 - (x - left))
            texel = level.offset + row * level.width + column
            red += weight * colors[texel, 0]
            green += weight * colors[texel, 1]
            blue += weight * colors[texel, 2]
    return red, green, blue


@device
def trilinear_color(colors, levels, chain, level, u, v):  # type: ignore[no-untyped-def]
    """Trilinear colour between the two nearest levels."""
    fine = int(level)
    weight = level - fine
    red, green, blue = _bilinear(colors, mip_level(levels, chain, fine), u, v)
    if weight > 0.0:
        r, g, b = _bilinear(colors, mip_level(levels, chain, fine + 1), u, v)
        red += weight * (r - red)
        green += weight * (g - green)
        blue += weight * (b - blue)
    return red, green, blue


@kernel
def _colors(begin, end, triangles, fragments, chains, materials, luminance, out):  # type: ignore[no-untyped-def]
    corners, uvs, material_of = triangles.corners_world, triangles.uvs, triangles.materials
    triangle, barycentric, area = fragments.triangle, fragments.barycentric, fragments.area_world
    colors, levels, transform = chains.colors, chains.levels, chains.transform
    first, level_count, wrap = chains.first, chains.level_count, chains.wrap
    chain_of, color_chain_of, base_color = materials.chain, materials.color_chain, materials.base_color
    for index in range(begin, end):
        t = triangle[index]
        material = material_of[t]
        k = color_chain_of[material] if color_chain_of[material] >= 0 else chain_of[material]
        red = float(base_color[material, 0])
        green = float(base_color[material, 1])
        blue = float(base_color[material, 2])
        if k >= 0:
            m = transform[k]
            s, r = uv_at(uvs[t], barycentric[index])
            u, v = on_texture(m, s, r)
            chain = MipChain(first[k], level_count[k], wrap[k])
            level = level_of_size(levels, chain, m, corners[t], uvs[t], area[index])
            while True:
                red, green, blue = trilinear_color(colors, levels, chain, level, u, v)
                if red + green + blue > 0.0 or level + 1.0 > chain.level_count - 1 or luminance[index] <= 0.0:
                    break
                level += 1.0
        own = RED * red + GREEN * green + BLUE * blue
        scale = luminance[index] / own if own > 0.0 else 0.0
        out[index, 0] = red * scale if own > 0.0 else luminance[index]
        out[index, 1] = green * scale if own > 0.0 else luminance[index]
        out[index, 2] = blue * scale if own > 0.0 else luminance[index]
