# SPDX-License-Identifier: GPL-3.0-or-later
"""Super-sampled pictures of an octree over black (methods 7.5), (H * W,) with row 0 at the bottom."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..octree.octree import LUMINANCE_SCALE, Octree
from ..octree.side_kernels import color_along, decode_color, luminance_of_sides, row_of
from ..octree.sides import NO_HIGHLIGHTS, HdrHighlights, NodeLight
from ..runtime.bounds import RAYS
from ..runtime.kernels import kernel, lean_device
from ..runtime.progress import Progress, Steps
from ..runtime.threads import run_parts
from ..runtime.vectors import LANES, lowest_one
from .camera import Camera, camera_in_unit_cube
from .chosen import aim_pixels, blocks, corner_of
from .tile import COARSE, DIRECTION, PACKETS, PIXEL, TILE, WANTED, Search, make_levels, make_tile, node_seen
from .tile_walk import trace_tile

MAX_SIDE = int(RAYS.high)  # per pixel side
_NO_CHROMA = np.empty((0, 2), np.uint8)
MEANS = 5  # luminance, red, green, blue, coverage
_ROWS_PER_STEP = 8


class PixelMeans(NamedTuple):
    """Means over side x side rays of N pixels, over a black background.

    luminance: (N,) float32. colors: (N, 3) float32 linear. coverage: (N,) float32, share of the rays that hit.
    """

    luminance: np.ndarray
    colors: np.ndarray
    coverage: np.ndarray


class _Light(NamedTuple):
    """Light of nodes: luminance with sides, chroma (empty for gray), and light above white."""

    nodes: NodeLight
    chroma: np.ndarray
    above_white: HdrHighlights


def supersample(
    octree: Octree, camera: Camera, side: int = MAX_SIDE, *, finer: float | None = None
) -> Steps[PixelMeans]:
    """All pixels, by side x side rays each at regular sub-pixel centres (methods 7.5), without light above white.

    Each ray has the footprint pixel / side, i.e. up to log2(side) levels deeper; with `finer`, pixel / finer. Colours
    are gray without colour. Raises SettingError for sample counts outside 1 to 32.
    """
    parts = []
    for row in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(row + _ROWS_PER_STEP, camera.height_px)
        pixels = np.arange(row * camera.width_px, last * camera.width_px)
        parts.append(_mean_of_rays(octree, NO_HIGHLIGHTS, camera, pixels, side, finer))  # errors use clamped luminance
        yield Progress(last, camera.height_px, f"Sampling {side}x{side}")
    return PixelMeans(*(np.concatenate(means) for means in zip(*parts, strict=True)))


def supersample_pixels(
    octree: Octree, camera: Camera, pixels: np.ndarray, side: int = MAX_SIDE, *, finer: float | None = None
) -> PixelMeans:
    """Pixels (N,) of `camera`, by their indices row * width + column, as in `supersample`.

    Colours include light above white.
    """
    return _mean_of_rays(octree, octree.hdr_highlights, camera, np.asarray(pixels, np.int64), side, finer)


def _mean_of_rays(
    octree: Octree, above_white: HdrHighlights, camera: Camera, pixels: np.ndarray, side: int, finer: float | None
) -> PixelMeans:
    """Means over side x side rays of each pixel (N,) int64.

    Without chroma, red, green and blue are the luminance. Light above white is added to red, green and blue only.
    """
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid).finer(side if finer is None else finer)
    light = _Light(octree.light, _NO_CHROMA if octree.chroma is None else octree.chroma, above_white)
    order, starts = blocks(pixels, unit.width_px, side)
    search = Search(unit.side_at_0, unit.side_per_z, 1.0, COARSE, octree.depth)
    means = np.empty((len(pixels), MEANS), np.float32)
    chosen = pixels[order], order, starts, side
    run_parts(_means_of_blocks, len(starts) - 1, octree.nodes, light, unit, search, chosen, means)
    return PixelMeans(means[:, 0].copy(), means[:, 1:4].copy(), means[:, 4].copy())


@kernel
def _means_of_blocks(first, last, nodes, light, camera, search, chosen, means):  # type: ignore[no-untyped-def]
    """Write the means of pixels: a block in one tile, or a pixel in several tiles. chosen: of `_mean_of_rays`."""
    pixels, places, starts, side = chosen
    scratch = make_tile(), make_levels(), np.empty((TILE * TILE, MEANS))
    for block in range(first, last):
        here = pixels[starts[block] : starts[block + 1]]
        _sum_rays(nodes, light, camera, search, here, side, scratch)
        for index in range(starts[block], starts[block + 1]):
            top, left = corner_of(camera, pixels[index], side)
            _write_means(scratch[2][top * TILE + left], len(light.chroma) > 0, side * side, means[places[index]])


@lean_device
def _sum_rays(nodes, light, camera, search, pixels, side, scratch):  # type: ignore[no-untyped-def]
    """Trace the rays of a block's pixels, and sum up the hits of each pixel."""
    tile, levels, sums = scratch
    sums[:] = 0.0
    for first_j in range(0, side, TILE):
        for first_i in range(0, side, TILE):
            aim_pixels(camera, tile, pixels, (first_j, first_i), side)
            trace_tile(nodes, search, tile, levels)
            for packet in range(PACKETS):
                left = tile.lanes[WANTED, packet]
                while left != 0:
                    ray = packet * LANES + lowest_one(left)
                    left &= left - 1
                    _add_ray(camera, tile, ray, light, sums[np.int64(tile.numbers[PIXEL, ray])])


@lean_device
def _add_ray(camera, tile, ray, light, sums):  # type: ignore[no-untyped-def]
    """Add the hit of a ray to the sums: luminance, colours, and the number of hits."""
    nodes, chroma, above = light
    node = node_seen(camera, tile, COARSE, ray)
    if node >= 0:
        numbers = tile.numbers
        x, y, z = numbers[DIRECTION, ray], numbers[DIRECTION + 1, ray], numbers[DIRECTION + 2, ray]
        row = row_of(nodes.sides, node)
        mean = np.float32(nodes.luminance[node])
        light = mean if row < 0 else luminance_of_sides(nodes, node, row, x, y, z)
        sums[0] += light
        sums[4] += 1.0
        if len(chroma):
            seen = decode_color(mean / LUMINANCE_SCALE, chroma[node, 0], chroma[node, 1])
            red, green, blue = seen if row < 0 else color_along(nodes.sides, row, seen, x, y, z)
            sums[1] += red
            sums[2] += green
            sums[3] += blue
        bright = row_of(above, node)
        if bright >= 0:
            scale = light / max(mean, np.float32(1))  # brightness of the visible side over the mean
            for channel in range(3):
                sums[1 + channel] += scale * above.colors[bright, channel]


@lean_device
def _write_means(sums, colored, rays, means):  # type: ignore[no-untyped-def]
    """Write the means (MEANS,) of a pixel's rays."""
    seen = sums[0] / LUMINANCE_SCALE
    means[0] = seen / rays
    for channel in range(1, 4):
        means[channel] = (sums[channel] + (0.0 if colored else seen)) / rays
    means[4] = sums[4] / rays
