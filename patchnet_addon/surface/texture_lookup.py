# SPDX-License-Identifier: GPL-3.0-or-later
"""Base luminance and opacity of fragments: the kernel over a `TextureTable` (methods 7.2a)."""

from __future__ import annotations

import math

import numba
import numpy as np

from ..runtime.kernels import device, kernel
from .footprint import ROWS, footprint_means, piece_on_texture
from .mesh import Fragments, TriangleBatch
from .texels import bilinear, cut
from .textures import TextureTable

# A bilinear lookup in a box-filtered level has the variance of a box sqrt(3) times as wide as its texels.
_LEVEL_BIAS = 0.5 * math.log2(3.0)
_CHUNK = 1024  # fragments that share the room for their outlines
_NO_KEYS = np.empty(0, np.uint64)
_NO_CORNERS = np.empty((0, 3, 3), np.float64)


def surface_of_fragments(
    table: TextureTable, batch: TriangleBatch, fragments: Fragments
) -> tuple[np.ndarray, np.ndarray]:
    """Luminance of the base colour (F,) and opacity (F,), both float32, means over each fragment.

    Where fragments know their outline, opacity is integrated over it; otherwise over a square of their size.
    """
    shine = np.empty(len(fragments), np.float32)
    opacity = np.empty(len(fragments), np.float32)
    outlined = fragments.cut_keys is not None and fragments.corners_voxel is not None
    _surface(
        batch.corners_world, batch.uvs, batch.materials, fragments.triangle, fragments.barycentric,
        fragments.area_world, fragments.cut_keys if outlined else _NO_KEYS,
        fragments.corners_voxel if outlined else _NO_CORNERS, table.texels, table.level_offset, table.level_height,
        table.level_width, table.pyramid_first, table.pyramid_levels, table.pyramid_extension,
        table.pyramid_transform, table.pyramid_solid, table.material_pyramid, table.material_color,
        table.material_luminance, table.material_opacity, table.material_threshold, shine, opacity,
    )  # fmt: skip
    return shine, opacity


@device
def _triangle_area(corners):  # type: ignore[no-untyped-def]
    ax = corners[1, 0] - corners[0, 0]
    ay = corners[1, 1] - corners[0, 1]
    az = corners[1, 2] - corners[0, 2]
    bx = corners[2, 0] - corners[0, 0]
    by = corners[2, 1] - corners[0, 1]
    bz = corners[2, 2] - corners[0, 2]
    cx = ay * bz - az * by
    cy = az * bx - ax * bz
    cz = ax * by - ay * bx
    return 0.5 * math.sqrt(cx * cx + cy * cy + cz * cz)


@device
def pyramid_level(corners, uvs, m, area, size, levels):  # type: ignore[no-untyped-def]
    """Level whose texels are as large as a fragment on a texture of `size` texels, as a fraction between levels."""
    du = uvs[1, 0] - uvs[0, 0]
    dv = uvs[1, 1] - uvs[0, 1]
    eu = uvs[2, 0] - uvs[0, 0]
    ev = uvs[2, 1] - uvs[0, 1]
    scale = abs(m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) * size
    whole = _triangle_area(corners)
    footprint = 0.5 * abs(du * ev - dv * eu) * scale * (area / whole if whole > 0.0 else 1.0)
    level = 0.5 * math.log2(max(footprint, 1e-12)) - _LEVEL_BIAS
    return min(max(level, 0.0), float(levels - 1))


@device
def _trilinear(texels, level_offset, level_height, level_width, first, level, extension, threshold, u, v):  # type: ignore[no-untyped-def]
    """Opacity * luminance, and opacity, around (u, v), between the two nearest levels."""
    fine = int(level)
    weight = level - fine
    shine = 0.0
    opacity = 0.0
    for step in range(2):
        share = weight if step else 1.0 - weight
        if share <= 0.0:
            continue
        at = first + fine + step
        one, other = bilinear(texels, level_offset[at], level_height[at], level_width[at], extension, u, v)
        if fine + step == 0:
            one, other = cut(one, other, threshold)
        shine += share * one
        opacity += share * other
    return shine, opacity


@device
def uv_at(uvs, barycentric):  # type: ignore[no-untyped-def]
    """UV coordinates of a point by those (3, 2) of its triangle's corners, and its share (2,) of the last two."""
    b1 = barycentric[0]
    b2 = barycentric[1]
    b0 = 1.0 - b1 - b2
    return b0 * uvs[0, 0] + b1 * uvs[1, 0] + b2 * uvs[2, 0], b0 * uvs[0, 1] + b1 * uvs[1, 1] + b2 * uvs[2, 1]


@device
def on_texture(m, s, r):  # type: ignore[no-untyped-def]
    """Transform UV coordinates (s, r) onto a texture with m (2, 3)."""
    return m[0, 0] * s + m[0, 1] * r + m[0, 2], m[1, 0] * s + m[1, 1] * r + m[1, 2]


@kernel
def _surface(  # type: ignore[no-untyped-def]
    corners, uvs, materials, triangle, barycentric, area, cut_keys, corners_voxel,
    texels, level_offset, level_height, level_width,
    pyramid_first, pyramid_levels, pyramid_extension, pyramid_transform, pyramid_solid,
    material_pyramid, material_color, material_luminance, material_opacity, material_threshold,
    shine_out, opacity_out,
):  # fmt: skip
    for chunk in numba.prange((len(triangle) + _CHUNK - 1) // _CHUNK):
        rows = np.empty((ROWS, 5), np.float64)
        for index in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, len(triangle))):
            t = triangle[index]
            material = materials[t]
            pyramid = material_pyramid[material]
            if pyramid < 0:
                shine_out[index] = material_luminance[material]
                opacity_out[index] = material_opacity[material]
                continue
            s, r = uv_at(uvs[t], barycentric[index])
            m = pyramid_transform[pyramid]
            u, v = on_texture(m, s, r)
            first = pyramid_first[pyramid]
            levels = pyramid_levels[pyramid]
            extension = pyramid_extension[pyramid]
            threshold = material_threshold[material] / material_opacity[material]
            shine = -1.0
            cover = -1.0
            if len(cut_keys) and not pyramid_solid[pyramid]:
                count = piece_on_texture(rows, corners_voxel, cut_keys[index], t, uvs[t], m)
                if count >= 3:
                    shine, cover = footprint_means(
                        rows, count, u, v, texels, level_offset, level_height, level_width, first, levels, extension,
                        threshold,
                    )  # fmt: skip
            if shine < 0.0 and cover != 0.0:
                level = pyramid_level(
                    corners[t], uvs[t], m, area[index], level_height[first] * level_width[first], levels
                )
                shine, other = _trilinear(
                    texels, level_offset, level_height, level_width, first, level, extension, threshold, u, v
                )  # fmt: skip
                shine = shine / other if other > 1e-6 else 0.0
                cover = other if cover < 0.0 else cover
            else:
                shine = shine / cover if cover > 1e-6 else 0.0
            color = material_color[material]
            if color >= 0:  # laid out in its own way
                m = pyramid_transform[color]
                u, v = on_texture(m, s, r)
                first = pyramid_first[color]
                size = level_height[first] * level_width[first]
                level = pyramid_level(corners[t], uvs[t], m, area[index], size, pyramid_levels[color])
                shine, other = _trilinear(
                    texels, level_offset, level_height, level_width, first, level, pyramid_extension[color], math.nan,
                    u, v,
                )  # fmt: skip
                shine = shine / other if other > 1e-6 else 0.0
            shine_out[index] = shine
            if math.isnan(threshold):
                cover *= material_opacity[material]
            opacity_out[index] = min(cover, 1.0)
