# SPDX-License-Identifier: GPL-3.0-or-later
"""Base colour of fragments, beside the luminance that `texture_lookup` finds (methods 7.2d).

Only the hue is looked up here, at the centroid and averaged over the fragment's size, farther where that meets nothing
but a gap; it is then brought to the luminance, so that opacity and luminance have one source, with and without colour.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..runtime.kernels import device, kernel
from .chroma import BLUE, GREEN, RED
from .mesh import Fragments, TriangleBatch
from .texels import wrapped
from .texture_lookup import on_texture, pyramid_level, uv_at
from .textures import TextureTable


def color_of_fragments(
    table: TextureTable, batch: TriangleBatch, fragments: Fragments, luminance: np.ndarray
) -> np.ndarray:
    """Linear base colour (F, 3) float32 of fragments with the given luminance (F,); gray where the material is black.

    The table must have been made with colour.
    """
    out = np.empty((len(fragments), 3), np.float32)
    _colors(
        batch.corners_world, batch.uvs, batch.materials, fragments.triangle, fragments.barycentric,
        fragments.area_world, np.asarray(luminance, np.float32), table.colors, table.level_offset, table.level_height,
        table.level_width, table.pyramid_first, table.pyramid_levels, table.pyramid_extension,
        table.pyramid_transform, table.material_pyramid, table.material_color, table.material_base, out,
    )  # fmt: skip
    return out


@device
def _bilinear(colors, offset, height, width, extension, u, v):  # type: ignore[no-untyped-def]
    """Opacity * red, green, blue at (u, v) in units of the texture."""
    x = u * width - 0.5
    y = v * height - 0.5
    left = math.floor(x)
    low = math.floor(y)
    red = 0.0
    green = 0.0
    blue = 0.0
    for dy in range(2):
        row = wrapped(int(low) + dy, height, extension)
        weight_y = y - low if dy else 1.0 - (y - low)
        for dx in range(2):
            column = wrapped(int(left) + dx, width, extension)
            if row < 0 or column < 0:
                continue
            weight = weight_y * (x - left if dx else 1.0 - (x - left))
            place = offset + row * width + column
            red += weight * colors[place, 0]
            green += weight * colors[place, 1]
            blue += weight * colors[place, 2]
    return red, green, blue


@device
def _trilinear(colors, level_offset, level_height, level_width, first, level, extension, u, v):  # type: ignore[no-untyped-def]
    """Trilinear colour between the two nearest levels."""
    fine = int(level)
    weight = level - fine
    at = first + fine
    red, green, blue = _bilinear(colors, level_offset[at], level_height[at], level_width[at], extension, u, v)
    if weight > 0.0:
        at += 1
        r, g, b = _bilinear(colors, level_offset[at], level_height[at], level_width[at], extension, u, v)
        red += weight * (r - red)
        green += weight * (g - green)
        blue += weight * (b - blue)
    return red, green, blue


@kernel
def _colors(  # type: ignore[no-untyped-def]
    corners, uvs, materials, triangle, barycentric, area, luminance, colors, level_offset, level_height, level_width,
    pyramid_first, pyramid_levels, pyramid_extension, pyramid_transform, material_pyramid, material_color,
    material_base, out,
):  # fmt: skip
    for index in numba.prange(len(triangle)):
        t = triangle[index]
        material = materials[t]
        pyramid = material_color[material] if material_color[material] >= 0 else material_pyramid[material]
        red = float(material_base[material, 0])
        green = float(material_base[material, 1])
        blue = float(material_base[material, 2])
        if pyramid >= 0:
            m = pyramid_transform[pyramid]
            s, r = uv_at(uvs[t], barycentric[index])
            u, v = on_texture(m, s, r)
            first = pyramid_first[pyramid]
            size = level_height[first] * level_width[first]
            level = pyramid_level(corners[t], uvs[t], m, area[index], size, pyramid_levels[pyramid])
            while True:
                red, green, blue = _trilinear(
                    colors, level_offset, level_height, level_width, first, level, pyramid_extension[pyramid], u, v
                )
                if red + green + blue > 0.0 or level + 1.0 > pyramid_levels[pyramid] - 1 or luminance[index] <= 0.0:
                    break
                level += 1.0
        own = RED * red + GREEN * green + BLUE * blue
        scale = luminance[index] / own if own > 0.0 else 0.0
        out[index, 0] = red * scale if own > 0.0 else luminance[index]
        out[index, 1] = green * scale if own > 0.0 else luminance[index]
        out[index, 2] = blue * scale if own > 0.0 else luminance[index]
