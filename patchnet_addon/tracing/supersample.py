# SPDX-License-Identifier: GPL-3.0-or-later
"""Super-sampled pictures of an octree (methods 7.5), (H * W,) with row 0 at the bottom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..octree.hdr_highlights import NO_HIGHLIGHTS, HdrHighlights
from ..octree.nodes import BoxedNodes
from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.bits import lowest_one
from ..runtime.bounds import RAYS
from ..runtime.kernels import kernel, lean_device
from ..runtime.progress import Progress, Steps
from ..runtime.threads import run_parts
from ..runtime.vectors import LANES
from ..surface.chroma_kernels import decode_color
from .camera import Camera, CameraUnit, camera_in_unit_cube
from .tile import (
    COARSE,
    PACKETS,
    PICTURE,
    PIXEL,
    TILE,
    WANTED,
    XS,
    YS,
    Search,
    aim_tile,
    make_levels,
    make_tile,
    node_seen,
    ray_of,
)
from .tile_walk import trace_tile

MAX_SIDE = int(RAYS.high)  # per pixel side
NO_CHROMA = np.empty((0, 2), np.uint8)
MEANS = 5  # luminance, red, green, blue, coverage
_ROWS_PER_STEP = 8
_RUN = 64  # pixels that one core takes at once; a multiple of those in a tile


class Sampled(NamedTuple):
    """Means over the rays of P pixels: luminance (P,), linear colours (P, 3), no rows without colour, and the share of
    rays that met something, coverage (P,); all float32."""

    luminance: np.ndarray
    colors: np.ndarray
    coverage: np.ndarray


def supersample(
    octree: Octree, camera: Camera, side: int = MAX_SIDE, background: float = 0.0, *, finer: float | None = None
) -> Steps[np.ndarray]:
    """Luminance (P,) float32, the mean of side x side rays per pixel at regular sub-pixel centres (methods 7.5).

    Each ray has the footprint pixel / side, i.e. up to log2(side) levels deeper; with `finer`, pixel / finer.
    """
    steps = _supersampled(octree, NO_CHROMA, camera, side, background, side if finer is None else finer)
    return (yield from steps)[0]


def supersample_all(octree: Octree, camera: Camera, side: int = MAX_SIDE) -> Steps[Sampled]:
    """All means of side x side rays a pixel over black, as of `supersample`; in colour if the octree is."""
    chroma = NO_CHROMA if octree.chroma is None else octree.chroma
    return (yield from _supersampled(octree, chroma, camera, side, 0.0, side))


def _supersampled(
    octree: Octree, chroma: np.ndarray, camera: Camera, side: int, background: float, finer: float
) -> Steps[Sampled]:
    """Means of the rays; colours unless `chroma` is empty."""
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid).finer(finer)
    luminance, coverage = (np.empty(camera.pixel_count, np.float32) for _ in range(2))
    colors = np.empty((camera.pixel_count if len(chroma) else 0, 3), np.float32)
    for row in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(row + _ROWS_PER_STEP, camera.height_px)
        here = slice(row * camera.width_px, last * camera.width_px)
        pixels = np.arange(here.start, here.stop, dtype=np.int64)
        pixels = pixels[block_order(pixels, camera.width_px, side)]
        means = np.empty((len(pixels), MEANS), np.float32)
        mean_of_rays(
            octree.boxed_nodes,
            (octree.luminance, chroma, NO_HIGHLIGHTS),  # errors are of what is clamped
            unit,
            pixels,
            (side, float(background), octree.depth),
            means,
        )
        luminance[pixels], coverage[pixels] = means[:, 0], means[:, 4]
        if len(chroma):
            colors[pixels] = means[:, 1:4]
        yield Progress(last, camera.height_px, f"Sampling {side}x{side}")
    return Sampled(luminance, colors, coverage)


def block_order(pixels: np.ndarray, width_px: int, side: int) -> np.ndarray:
    """Order (N,) int64 of pixels (N,) by the blocks of the picture whose side x side rays fill a tile."""
    across = TILE // side
    if across < 2:
        return np.arange(len(pixels))
    row, column = np.divmod(pixels, width_px)
    block = row // across * width_px + column // across
    return np.argsort((block * across + row % across) * across + column % across)


def mean_of_rays(
    nodes: BoxedNodes,
    light: tuple[np.ndarray, np.ndarray, HdrHighlights],
    camera: CameraUnit,
    pixels: np.ndarray,
    sampling: tuple[int, float, int],
    means: np.ndarray,
) -> None:
    """Write what side x side rays of each pixel (N,) see into `means` (N, MEANS) float32.

    light: luminance and chroma of the nodes, and what is above white. sampling: side, background, depth of the octree.

    Means are those of luminance, red, green, blue, and the share of the rays that met something. Without chroma (0, 2),
    red, green and blue are the luminance. What is above white is added to red, green and blue alone.
    """
    run_parts(_means_of_runs, -(-len(pixels) // _RUN), nodes, light, camera, pixels, sampling, means)


@kernel
def _means_of_runs(first, last, nodes, light, camera, pixels, sampling, means):  # type: ignore[no-untyped-def]
    """Write the means of runs of pixels."""
    scratch = make_tile(), make_levels(), np.empty((TILE * TILE, MEANS))
    begin, end = first * _RUN, last * _RUN
    _means_of_pixels(nodes, light, camera, pixels[begin:end], sampling, scratch, means[begin:end])


@lean_device
def _means_of_pixels(nodes, light, camera, pixels, sampling, scratch, means):  # type: ignore[no-untyped-def]
    """Trace the rays of as many pixels as have room in one tile, or of one in several tiles, and write their means.

    sampling: side, background, depth of the octree.
    """
    side = sampling[0]
    across = max(TILE // side, 1)  # pixels along a side of a tile
    tile, levels, sums = scratch
    search = Search(camera.side_at_0, camera.side_per_z, 1.0, COARSE, sampling[2])
    for first in range(0, len(pixels), across * across):
        count = min(across * across, len(pixels) - first)
        sums[:] = 0.0
        for first_j in range(0, side, TILE):
            for first_i in range(0, side, TILE):
                tile.lanes[WANTED, :] = 0
                for spot in range(count):
                    _aim_pixel(camera, tile, pixels[first + spot], (first_j, first_i), side, spot)
                aim_tile(camera, tile)
                trace_tile(nodes, search, tile, levels)
                for packet in range(PACKETS):
                    left = tile.lanes[WANTED, packet]
                    while left != 0:
                        ray = packet * LANES + lowest_one(left)
                        left &= left - 1
                        _add_ray(camera, tile, ray, light, sums[np.int64(tile.numbers[PIXEL, ray])])
        for spot in range(count):
            _write_means(sums[spot], light, sampling, means[first + spot])


@lean_device
def _aim_pixel(camera, tile, pixel, corner, side, spot):  # type: ignore[no-untyped-def]
    """Give rays of a tile the picture coordinates of a pixel's samples from row and column `corner` on.

    spot: index of the pixel in the tile, row by row.
    """
    across = max(TILE // side, 1)
    top, left = side * (spot // across), side * (spot % across)
    row, column = pixel // camera.width_px, pixel % camera.width_px
    for k in range(min(side, TILE)):
        tile.numbers[XS, k] = 2.0 * (column + (corner[1] + k + 0.5) / side) / camera.width_px - 1.0
        tile.numbers[YS, k] = 2.0 * (row + (corner[0] + k + 0.5) / side) / camera.height_px - 1.0
    for j in range(min(TILE, side - corner[0])):
        for i in range(min(TILE, side - corner[1])):
            ray = ray_of(top + j, left + i)
            tile.numbers[PICTURE, ray], tile.numbers[PICTURE + 1, ray] = tile.numbers[XS, i], tile.numbers[YS, j]
            tile.numbers[PIXEL, ray] = spot
            tile.lanes[WANTED, ray // LANES] |= np.int64(1) << (ray % LANES)


@lean_device
def _add_ray(camera, tile, ray, light, sums):  # type: ignore[no-untyped-def]
    """Add what a ray has met to the sums: stored luminance, whose sum is exact, colours, and the number of hits."""
    luminance, chroma, above = light
    node = node_seen(camera, tile, COARSE, ray)
    if node >= 0:
        sums[0] += luminance[node]
        sums[4] += 1.0
        if len(chroma):
            seen = luminance[node] / LUMINANCE_SCALE
            red, green, blue = decode_color(seen, chroma[node, 0], chroma[node, 1])
            sums[1] += red
            sums[2] += green
            sums[3] += blue
        if len(above.bits) and above.bits[node >> 3] >> (node & 7) & 1:
            _add_above_white(above, node, sums)


@lean_device
def _add_above_white(above, node, sums):  # type: ignore[no-untyped-def]
    """Add the light above white of a node that has some."""
    first, last = 0, len(above.nodes) - 1
    while first < last:
        middle = (first + last) >> 1
        if above.nodes[middle] < node:
            first = middle + 1
        else:
            last = middle
    for channel in range(3):
        sums[1 + channel] += above.colors[first, channel]


@lean_device
def _write_means(sums, light, sampling, means):  # type: ignore[no-untyped-def]
    """Write the means (MEANS,) of a pixel."""
    side, background, _ = sampling
    rays = side * side
    missed = background * (rays - sums[4])
    seen = sums[0] / LUMINANCE_SCALE + missed
    means[0] = seen / rays
    for channel in range(1, 4):
        means[channel] = (sums[channel] + (missed if len(light[1]) else seen)) / rays
    means[4] = sums[4] / rays


@dataclass(frozen=True, eq=False)
class PixelMeans:
    """Means over side x side rays of N pixels, over a black background.

    luminance: (N,) float32, as `supersample` computes it. colors: (N, 3) float32 linear, gray without colour, with what
    is above white, which luminance is without.
    coverage: (N,) float32, share of the rays that met something.
    """

    luminance: np.ndarray
    colors: np.ndarray
    coverage: np.ndarray


def supersample_pixels(
    octree: Octree, camera: Camera, pixels: np.ndarray, side: int = MAX_SIDE, *, finer: float | None = None
) -> PixelMeans:
    """Pixels (N,) of `camera`, by their indices row * width + column, with side x side rays each.

    Each ray has the footprint pixel / side; with `finer`, pixel / finer. Raises SettingError for sample counts outside
    1 to 32.
    """
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid).finer(side if finer is None else finer)
    chroma = NO_CHROMA if octree.chroma is None else octree.chroma
    pixels = np.asarray(pixels, np.int64)
    order = block_order(pixels, camera.width_px, side)
    found = np.empty((len(pixels), MEANS), np.float32)
    light = octree.luminance, chroma, octree.hdr_highlights
    mean_of_rays(octree.boxed_nodes, light, unit, pixels[order], (side, 0.0, octree.depth), found)
    means = np.empty_like(found)
    means[order] = found
    return PixelMeans(means[:, 0].copy(), means[:, 1:4].copy(), means[:, 4].copy())
