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
from .camera import Camera, CameraUnit, camera_in_unit_cube
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
) -> Steps[np.ndarray]:
    """Luminance (P,) float32, the mean of side x side rays per pixel at regular sub-pixel centres (methods 7.5).

    Each ray has the footprint pixel / side, i.e. up to log2(side) levels deeper; with `finer`, pixel / finer.
    """
    return (yield from _supersampled(octree, _NO_CHROMA, camera, side, side if finer is None else finer)).luminance


def supersample_all(octree: Octree, camera: Camera, side: int = MAX_SIDE) -> Steps[PixelMeans]:
    """All means of side x side rays per pixel, as in `supersample`; colours have no rows if the octree is gray."""
    return (yield from _supersampled(octree, _chroma(octree), camera, side, side))


def supersample_pixels(
    octree: Octree, camera: Camera, pixels: np.ndarray, side: int = MAX_SIDE, *, finer: float | None = None
) -> PixelMeans:
    """Pixels (N,) of `camera`, by their indices row * width + column, with side x side rays each.

    Each ray has the footprint pixel / side; with `finer`, pixel / finer. Luminance is as in `supersample`; colours,
    gray without colour, include light above white. Raises SettingError for sample counts outside 1 to 32.
    """
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid).finer(side if finer is None else finer)
    light = _Light(octree.light, _chroma(octree), octree.hdr_highlights)
    means = _mean_of_rays(octree, light, unit, np.asarray(pixels, np.int64), side)
    return PixelMeans(means[:, 0].copy(), means[:, 1:4].copy(), means[:, 4].copy())


def _chroma(octree: Octree) -> np.ndarray:
    return _NO_CHROMA if octree.chroma is None else octree.chroma


def _supersampled(octree: Octree, chroma: np.ndarray, camera: Camera, side: int, finer: float) -> Steps[PixelMeans]:
    """Means of the rays of all pixels; colours unless `chroma` is empty."""
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid).finer(finer)
    light = _Light(octree.light, chroma, NO_HIGHLIGHTS)  # errors use clamped luminance
    luminance, coverage = (np.empty(camera.pixel_count, np.float32) for _ in range(2))
    colors = np.empty((camera.pixel_count if len(chroma) else 0, 3), np.float32)
    for row in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(row + _ROWS_PER_STEP, camera.height_px)
        here = slice(row * camera.width_px, last * camera.width_px)
        means = _mean_of_rays(octree, light, unit, np.arange(here.start, here.stop, dtype=np.int64), side)
        luminance[here], coverage[here] = means[:, 0], means[:, 4]
        if len(chroma):
            colors[here] = means[:, 1:4]
        yield Progress(last, camera.height_px, f"Sampling {side}x{side}")
    return PixelMeans(luminance, colors, coverage)


def _mean_of_rays(octree: Octree, light: _Light, camera: CameraUnit, pixels: np.ndarray, side: int) -> np.ndarray:
    """Means (N, MEANS) float32 over side x side rays of each pixel (N,) int64: luminance, red, green, blue, and the
    share of the rays that hit.

    Without chroma, red, green and blue are the luminance. Light above white is added to red, green and blue only.
    """
    order, starts = blocks(pixels, camera.width_px, side)
    search = Search(camera.side_at_0, camera.side_per_z, 1.0, COARSE, octree.depth)
    means = np.empty((len(pixels), MEANS), np.float32)
    chosen = pixels[order], order, starts, side
    run_parts(_means_of_blocks, len(starts) - 1, octree.nodes, light, camera, search, chosen, means)
    return means


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
