# SPDX-License-Identifier: GPL-3.0-or-later
"""Base luminance and opacity of fragments: kernels over a `TextureTable`."""

from __future__ import annotations

import math

import numba
import numpy as np

from ..kernels import device, kernel
from ..octree.mesh import Fragments, TriangleBatch
from .textures import CLIP, EXTEND, MIRROR, TextureTable

# A bilinear lookup in a box-filtered level has the variance of a box sqrt(3) times as wide as its texels.
_LEVEL_BIAS = 0.5 * math.log2(3.0)


def surface_of_fragments(
    table: TextureTable, batch: TriangleBatch, fragments: Fragments
) -> tuple[np.ndarray, np.ndarray]:
    """Luminance of the base colour (F,) and opacity (F,), both float32."""
    shine = np.empty(len(fragments), np.float32)
    opacity = np.empty(len(fragments), np.float32)
    _surface(
        batch.corners_world, batch.uvs, batch.materials, fragments.triangle, fragments.barycentric,
        fragments.area_world, table.texels, table.level_offset, table.level_height, table.level_width,
        table.pyramid_first, table.pyramid_levels, table.pyramid_extension, table.pyramid_transform,
        table.material_pyramid, table.material_luminance, table.material_opacity, table.material_threshold,
        shine, opacity,
    )  # fmt: skip
    return shine, opacity


@device
def _wrapped(index, size, extension):  # type: ignore[no-untyped-def]
    """Texel index by the texture's extension; -1 outside of a clipped one."""
    if 0 <= index < size:
        return index
    if extension == EXTEND:
        return min(max(index, 0), size - 1)
    if extension == CLIP:
        return -1
    if extension == MIRROR:
        index = index % (2 * size)
        return index if index < size else 2 * size - 1 - index
    return index % size


@device
def _bilinear(texels, offset, height, width, extension, u, v):  # type: ignore[no-untyped-def]
    """Opacity * luminance, and opacity, at (u, v) in units of the texture."""
    x = u * width - 0.5
    y = v * height - 0.5
    left = math.floor(x)
    low = math.floor(y)
    fx = x - left
    fy = y - low
    shine = 0.0
    opacity = 0.0
    for dy in range(2):
        row = _wrapped(int(low) + dy, height, extension)
        weight_y = fy if dy else 1.0 - fy
        for dx in range(2):
            column = _wrapped(int(left) + dx, width, extension)
            if row < 0 or column < 0:
                continue
            weight = weight_y * (fx if dx else 1.0 - fx)
            place = offset + row * width + column
            shine += weight * texels[place, 0]
            opacity += weight * texels[place, 1]
    return shine, opacity


@device
def _cut(shine, opacity, threshold):  # type: ignore[no-untyped-def]
    """The finest level keeps uncut opacity: cut it here."""
    if math.isnan(threshold):
        return shine, opacity
    if opacity >= threshold and opacity > 0.0:
        return shine / opacity, 1.0
    return 0.0, 0.0


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


@kernel
def _surface(  # type: ignore[no-untyped-def]
    corners, uvs, materials, triangle, barycentric, area, texels, level_offset, level_height, level_width,
    pyramid_first, pyramid_levels, pyramid_extension, pyramid_transform,
    material_pyramid, material_luminance, material_opacity, material_threshold, shine_out, opacity_out,
):  # fmt: skip
    for index in numba.prange(len(triangle)):
        t = triangle[index]
        material = materials[t]
        pyramid = material_pyramid[material]
        if pyramid < 0:
            shine_out[index] = material_luminance[material]
            opacity_out[index] = material_opacity[material]
            continue
        m = pyramid_transform[pyramid]
        b1 = barycentric[index, 0]
        b2 = barycentric[index, 1]
        b0 = 1.0 - b1 - b2
        s = b0 * uvs[t, 0, 0] + b1 * uvs[t, 1, 0] + b2 * uvs[t, 2, 0]
        r = b0 * uvs[t, 0, 1] + b1 * uvs[t, 1, 1] + b2 * uvs[t, 2, 1]
        u = m[0, 0] * s + m[0, 1] * r + m[0, 2]
        v = m[1, 0] * s + m[1, 1] * r + m[1, 2]
        # Area of the fragment on the texture, in texels of the finest level.
        du = uvs[t, 1, 0] - uvs[t, 0, 0]
        dv = uvs[t, 1, 1] - uvs[t, 0, 1]
        eu = uvs[t, 2, 0] - uvs[t, 0, 0]
        ev = uvs[t, 2, 1] - uvs[t, 0, 1]
        first = pyramid_first[pyramid]
        scale = abs(m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) * level_height[first] * level_width[first]
        whole = _triangle_area(corners[t])
        footprint = 0.5 * abs(du * ev - dv * eu) * scale * (area[index] / whole if whole > 0.0 else 1.0)
        level = 0.5 * math.log2(max(footprint, 1e-12)) - _LEVEL_BIAS
        last = pyramid_levels[pyramid] - 1
        level = min(max(level, 0.0), float(last))
        fine = min(int(level), last)
        weight = level - fine
        threshold = material_threshold[material] / material_opacity[material]
        extension = pyramid_extension[pyramid]
        shine = 0.0
        opacity = 0.0
        for step in range(2):
            share = weight if step else 1.0 - weight
            if share <= 0.0:
                continue
            at = first + fine + step
            one, other = _bilinear(
                texels, level_offset[at], level_height[at], level_width[at], extension, u, v
            )  # fmt: skip
            if fine + step == 0:
                one, other = _cut(one, other, threshold)
            shine += share * one
            opacity += share * other
        shine_out[index] = shine / opacity if opacity > 1e-6 else 0.0
        if math.isnan(threshold):
            opacity *= material_opacity[material]
        opacity_out[index] = min(opacity, 1.0)
