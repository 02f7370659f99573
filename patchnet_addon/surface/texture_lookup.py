# SPDX-License-Identifier: GPL-3.0-or-later
"""Base luminance, opacity (methods 7.2a) and base colour of fragments (methods 7.2d): kernels over a `TextureTable`.

Of colours only the hue is looked up, at the centroid and averaged over the fragment's size, or a larger area if that is
only a gap. It is then scaled to the luminance, so that opacity and luminance have one source, with and without colour.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .chroma import BLUE, GREEN, RED
from .footprint import ROWS, footprint_means, piece_on_texture
from .mesh import FragmentArrays, Fragments, TriangleArrays, TriangleBatch
from .polygon import COLUMNS
from .texels import MipChain, bilinear, cut, mip_level, on_texture, texels_around
from .textures import LEAST_BASE, LEVEL_BIAS, MaterialTable, MipChains, TextureTable


def surface_of_fragments(
    table: TextureTable, batch: TriangleBatch, fragments: Fragments
) -> tuple[np.ndarray, np.ndarray]:
    """Luminance of the base colour (F,) and opacity (F,), both float32, means over each fragment.

    Opacity is integrated over a fragment's outline if available, otherwise over a square of its size.
    """
    if fragments.surface is not None:
        return fragments.surface[0].copy(), fragments.surface[1].copy()
    luminance = np.empty(len(fragments), np.float32)
    opacity = np.empty(len(fragments), np.float32)
    run_parts(
        _surface, len(fragments), batch.arrays, fragments.arrays, table.chains, table.materials, luminance, opacity
    )
    return luminance, opacity


@device
def _triangle_area(corners):
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
def level_of_size(levels, chain, m, corners, uvs, area):
    """Level of a mip chain whose texels are as large as a fragment on the texture, as a fraction between levels.

    m: (2, 3) transform of the texture. corners: (3, 3) and uvs: (3, 2) of the triangle. area: of the fragment, in the
    unit of the corners.
    """
    finest = mip_level(levels, chain, 0)
    du = uvs[1, 0] - uvs[0, 0]
    dv = uvs[1, 1] - uvs[0, 1]
    eu = uvs[2, 0] - uvs[0, 0]
    ev = uvs[2, 1] - uvs[0, 1]
    scale = abs(m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) * (finest.height * finest.width)
    whole = _triangle_area(corners)
    footprint = 0.5 * abs(du * ev - dv * eu) * scale * (area / whole if whole > 0.0 else 1.0)
    level = 0.5 * math.log2(max(footprint, 1e-12)) - LEVEL_BIAS
    coarsest = float(chain.level_count - 1)
    return max(level, 0.0) if level < coarsest else coarsest  # also of UVs whose area overflows


@device
def trilinear_luminance(texels, levels, chain, level, threshold, u, v):
    """Opacity * luminance, and opacity, around (u, v), between the two nearest levels."""
    fine = int(level)
    weight = level - fine
    premultiplied = 0.0
    opacity = 0.0
    for step in range(2):
        share = weight if step else 1.0 - weight
        if share <= 0.0:
            continue
        part, part_opacity = bilinear(texels, mip_level(levels, chain, fine + step), u, v)
        if fine + step == 0:
            part, part_opacity = cut(part, part_opacity, threshold)
        premultiplied += share * part
        opacity += share * part_opacity
    return premultiplied, opacity


@device
def uv_at(uvs, barycentric):
    """UV coordinates of a point by those (3, 2) of its triangle's corners, and its share (2,) of the last two."""
    b1 = barycentric[0]
    b2 = barycentric[1]
    b0 = 1.0 - b1 - b2
    return b0 * uvs[0, 0] + b1 * uvs[1, 0] + b2 * uvs[2, 0], b0 * uvs[0, 1] + b1 * uvs[1, 1] + b2 * uvs[2, 1]


@kernel
def _surface(
    begin: int, end: int, triangles: TriangleArrays, fragments: FragmentArrays, chains: MipChains,
    materials: MaterialTable, luminance_out: np.ndarray, opacity_out: np.ndarray,
) -> None:  # fmt: skip
    corners, uvs, material_of = triangles.corners_world, triangles.uvs, triangles.materials
    triangle, barycentric, area = fragments.triangle, fragments.barycentric, fragments.area_world
    cut_keys, corners_voxel = fragments.cut_keys, fragments.corners_voxel
    texels, levels, transform, solid = chains.texels, chains.levels, chains.transform, chains.solid
    first, level_count, wrap = chains.first, chains.level_count, chains.wrap
    chain_of, color_chain_of = materials.chain, materials.color_chain
    plain_luminance, plain_opacity, thresholds = materials.luminance, materials.opacity, materials.threshold
    rows = np.empty((ROWS, COLUMNS), np.float64)
    for index in range(begin, end):
        t = triangle[index]
        material = material_of[t]
        k = chain_of[material]
        if k < 0:
            luminance_out[index] = plain_luminance[material]
            opacity_out[index] = plain_opacity[material]
            continue
        s, r = uv_at(uvs[t], barycentric[index])
        m = transform[k]
        u, v = on_texture(m, s, r)
        chain = MipChain(first[k], level_count[k], wrap[k])
        threshold = thresholds[material] / plain_opacity[material]
        premultiplied = -1.0
        opacity = -1.0
        if len(cut_keys) and not solid[k]:
            count = piece_on_texture(rows, corners_voxel, cut_keys[index], t, uvs[t], m)
            if count >= 3:
                premultiplied, opacity = footprint_means(rows, count, u, v, texels, levels, chain, threshold)
        if premultiplied < 0.0 and opacity != 0.0:
            level = level_of_size(levels, chain, m, corners[t], uvs[t], area[index])
            premultiplied, around = trilinear_luminance(texels, levels, chain, level, threshold, u, v)
            luminance = premultiplied / around if around > 1e-6 else 0.0
            opacity = around if opacity < 0.0 else opacity
        else:
            luminance = premultiplied / opacity if opacity > 1e-6 else 0.0
        k = color_chain_of[material]
        if k >= 0:  # the colour has its own layout
            m = transform[k]
            u, v = on_texture(m, s, r)
            chain = MipChain(first[k], level_count[k], wrap[k])
            level = level_of_size(levels, chain, m, corners[t], uvs[t], area[index])
            premultiplied, around = trilinear_luminance(texels, levels, chain, level, math.nan, u, v)
            luminance = premultiplied / around if around > 1e-6 else 0.0
        luminance_out[index] = luminance
        if math.isnan(threshold):
            opacity *= plain_opacity[material]
        opacity_out[index] = min(opacity, 1.0)


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


class BaseColors(NamedTuple):
    """Base colours of M materials. reflects: (M,) bool, those whose light is in proportion to a known base colour."""

    table: TextureTable
    reflects: np.ndarray


def base_of_fragments(colors: BaseColors, batch: TriangleBatch, fragments: Fragments, *, color: bool) -> np.ndarray:
    """Luminance, with `color` also red, green and blue, by which light is multiplied: (F, 1) or (F, 4) float32.

    It is 1 for materials that do not reflect so.
    """
    table = colors.table
    luminance, _ = surface_of_fragments(table, batch, fragments)
    base = luminance[:, None]
    if color:
        base = np.concatenate([base, color_of_fragments(table, batch, fragments, luminance)], axis=1)
    chosen = colors.reflects[batch.materials[fragments.triangle]]
    return np.where(chosen[:, None], np.maximum(base, LEAST_BASE), np.float32(1.0))


@device
def _bilinear(colors, level, u, v):
    """Opacity * red, green, blue at (u, v) in units of the texture."""
    red = green = blue = 0.0
    around, weights = texels_around(level, u, v)
    for corner in range(4):
        texel, weight = around[corner], weights[corner]
        if texel >= 0:
            red += weight * colors[texel, 0]
            green += weight * colors[texel, 1]
            blue += weight * colors[texel, 2]
    return red, green, blue


@device
def trilinear_color(colors, levels, chain, level, u, v):
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
def _colors(
    begin: int, end: int, triangles: TriangleArrays, fragments: FragmentArrays, chains: MipChains,
    materials: MaterialTable, luminance: np.ndarray, out: np.ndarray,
) -> None:  # fmt: skip
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
