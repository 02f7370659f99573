# SPDX-License-Identifier: GPL-3.0-or-later
"""Places in texels, and base colours of an atlas: divisors of the baked light of its texels (methods 7.2c, 7.2g)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..octree.voxelize import triangle_areas_and_normals
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.mesh import MeshSource, TriangleBatch
from ..surface.texels import MipChain, on_texture
from ..surface.texture_lookup import (
    level_of_size,
    trilinear_color,
    trilinear_luminance,
    uv_at,
)
from ..surface.textures import TextureTable
from .atlas import COLOR_CHANNELS, MIN_OPACITY, Atlas
from .chart_lookup import texel_owners
from .charts import Charts
from .packing import SINGLE

_PLACES = 4  # lookups along a texel's side, for textured base colours
_EMPTY = 1e-6  # weight of a transparent part: a fully transparent texel still has a colour


@dataclass(frozen=True, eq=False)
class BatchTexels:
    """Texels of an atlas that belong to triangles of one batch.

    texels: (n,) int64 of all pages. triangles: (n,) int64 in the batch. corners: (T, 3, 2) float64 of the batch's
    triangles on their pages (`Charts.corner_texels`), whose side is `page_side`.
    """

    texels: np.ndarray
    triangles: np.ndarray
    corners: np.ndarray
    page_side: int

    def __len__(self) -> int:
        return len(self.texels)


def texel_centres(own: BatchTexels) -> np.ndarray:
    """Weights (n, 2) float32 of corners 1 and 2 at each texel's centre, moved into the triangle."""
    out = np.empty((len(own), 2), np.float32)
    run_parts(_centres, len(own), (own.texels, own.triangles, own.corners), own.page_side, out)
    return out


@device
def texel_frame(texel, corners, page_side):  # type: ignore[no-untyped-def]
    """Offset of a texel's lower left from a triangle's first corner, (2,), edges to the others, (2,) each, and area."""
    left = texel % page_side - corners[0, 0]
    low = texel // page_side % page_side - corners[0, 1]
    one_x = corners[1, 0] - corners[0, 0]
    one_y = corners[1, 1] - corners[0, 1]
    two_x = corners[2, 0] - corners[0, 0]
    two_y = corners[2, 1] - corners[0, 1]
    return left, low, one_x, one_y, two_x, two_y, one_x * two_y - one_y * two_x


@device
def place_in_texel(frame, i, j, side, spread):  # type: ignore[no-untyped-def]
    """Weights of corners 1 and 2 at the place (i, j) of side x side in a texel.

    Places are the centres of equal parts of a square of width `spread` around the texel's centre, column by column;
    those outside the triangle are moved into it.
    """
    left, low, one_x, one_y, two_x, two_y, area = frame
    x = left + 0.5 + ((i + 0.5) / side - 0.5) * spread
    y = low + 0.5 + ((j + 0.5) / side - 0.5) * spread
    one = max((x * two_y - y * two_x) / area, 0.0)
    two = max((one_x * y - one_y * x) / area, 0.0)
    beyond = max(one + two, 1.0)
    return one / beyond, two / beyond


@kernel
def _centres(first, last, own, page_side, out):  # type: ignore[no-untyped-def]
    texels, triangles, corners = own
    for index in range(first, last):
        frame = texel_frame(texels[index], corners[triangles[index]], page_side)
        out[index, 0], out[index, 1] = place_in_texel(frame, 0, 0, 1, 1.0)


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
    found[~textured] = _plain(table, colored)[materials[~textured]]
    left = np.flatnonzero(textured)
    share = area[left] * (spread / _PLACES) ** 2
    texels = own.texels[left], own.triangles[left], own.corners, own.page_side, share, float(spread)
    means = np.empty((len(left), found.shape[1]), np.float32)
    run_parts(_means, len(left), texels, batch.arrays, table.chains, table.materials, means)
    found[left] = means
    return found


def _plain(table: TextureTable, colored: bool) -> np.ndarray:
    """Base colours (M, 1 or 3) of all materials of a table without their textures."""
    luminance = table.materials.luminance
    if not colored:
        return luminance[:, None]
    red, green, blue = table.materials.base_color.astype(np.float64).T
    own = RED * red + GREEN * green + BLUE * blue
    scale = luminance / np.where(own > 0.0, own, 1.0)
    red, blue = (np.where(own > 0.0, channel * scale, luminance) for channel in (red, blue))
    return np.stack([luminance, red, blue], axis=1).astype(np.float32)


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


class TexelBases(NamedTuple):
    """Base colours of the texels of one batch that have surface and do not emit.

    own: n texels. area: (n,) float64, surface of each texel. color: (n, 1) float32, luminance, or (n, 3), with red and
    blue.
    """

    batch: TriangleBatch
    own: BatchTexels
    area: np.ndarray
    color: np.ndarray


def texel_bases(atlas: Atlas, source: MeshSource) -> Iterator[TexelBases]:
    """Base colours of an atlas, batch by batch."""
    colored = atlas.texels.shape[1] == COLOR_CHANNELS
    table = TextureTable.from_materials(source.materials, color=colored)
    charts, (index, triangle) = atlas.charts, _owned(atlas.charts)
    for batch in source.batches():
        first, last = np.searchsorted(triangle, [batch.first_triangle, batch.first_triangle + len(batch)])
        mine, local = index[first:last], triangle[first:last].astype(np.int64) - batch.first_triangle
        plain = table.materials.emission[batch.materials[local]] <= 0.0
        keep = plain & (atlas.texels[mine, 1] > MIN_OPACITY)
        mine, local = mine[keep], local[keep]
        if not len(mine):
            continue
        corners = charts.corner_texels(np.arange(batch.first_triangle, batch.first_triangle + len(batch)))
        own = BatchTexels(mine, local, corners, charts.page_side)
        area = _texel_areas(charts, batch)[local]
        yield TexelBases(batch, own, area, base_colors(table, batch, own, area, spread=atlas.spread, colored=colored))


def base_of_texels(atlas: Atlas, source: MeshSource) -> np.ndarray:
    """Base colours of all texels, as in `Atlas.base`; 0 in unused texels."""
    found = np.zeros((len(atlas.texels), 3 if atlas.texels.shape[1] == COLOR_CHANNELS else 1), np.float32)
    for part in texel_bases(atlas, source):
        found[part.own.texels] = part.color
    return found


def _texel_areas(charts: Charts, batch: TriangleBatch) -> np.ndarray:
    """Area (T,) float64, world units, of one texel on each of the batch's triangles."""
    numbers = slice(batch.first_triangle, batch.first_triangle + len(batch))
    logs = charts.log_width[numbers].astype(np.float64) + charts.log_height[numbers]
    areas, _ = triangle_areas_and_normals(batch.corners_world)
    return np.asarray(areas / np.where(charts.kind[numbers] == SINGLE, 1.0, np.exp2(logs) / 2.0))


def _owned(charts: Charts) -> tuple[np.ndarray, np.ndarray]:
    """Texels (n,) int64 of the atlas with a triangle, and the triangles (n,) int32, in their order."""
    side = charts.page_side**2
    owners = [texel_owners(charts, page) for page in range(charts.page_count)]
    index = np.concatenate([np.flatnonzero(own >= 0) + page * side for page, own in enumerate(owners)])
    triangle = np.concatenate([own[own >= 0] for own in owners])
    order = np.argsort(triangle, kind="stable")
    return index[order], triangle[order]
