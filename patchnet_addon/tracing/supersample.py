# SPDX-License-Identifier: GPL-3.0-or-later
"""Super-sampled pictures of an octree (methods 7.5), (H * W,) with row 0 at the bottom."""

from __future__ import annotations

import numba
import numpy as np

from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.bounds import RAYS
from ..runtime.kernels import device, kernel, lean_device
from ..runtime.progress import Progress, Steps
from ..runtime.vectors import LANES, first_bit
from ..surface.chroma_kernels import decode_color
from .camera import Camera, camera_in_unit_cube
from .tile import COARSE, PACKETS, TILE, Search, aim_tile, make_levels, make_tile, node_seen, want_pixels
from .tile_walk import trace_tile

MAX_SIDE = int(RAYS.high)  # per pixel side
NO_CHROMA = np.empty((0, 2), np.uint8)
MEANS = 5  # luminance, red, green, blue, coverage
_ROWS_PER_STEP = 8
_RUN = 16  # pixels that one core takes at once


def supersample(
    octree: Octree, camera: Camera, side: int = MAX_SIDE, background: float = 0.0, *, same_lod: bool = False
) -> Steps[np.ndarray]:
    """Luminance (P,) float32, the mean of side x side rays per pixel at regular sub-pixel centres (methods 7.5).

    Each ray has the footprint pixel / side, i.e. up to log2(side) levels deeper; same_lod keeps the pixel's own.
    """
    steps = _supersampled(octree, NO_CHROMA, camera, side, background, same_lod)
    return (yield from steps)[0]


def supersample_colors(
    octree: Octree, camera: Camera, side: int = MAX_SIDE, background: float = 0.0
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Luminance (P,) as of `supersample`, and the mean linear colours (P, 3) float32; the octree must have colour."""
    assert octree.chroma is not None
    return (yield from _supersampled(octree, octree.chroma, camera, side, background, same_lod=False))


def _supersampled(
    octree: Octree, chroma: np.ndarray, camera: Camera, side: int, background: float, same_lod: bool
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Luminance (P,), and colours (P, 3) unless `chroma` is empty."""
    RAYS.check(side)
    unit = camera_in_unit_cube(camera, octree.grid)
    unit = unit if same_lod else unit.finer(side)
    luminance = np.empty(camera.pixel_count, np.float32)
    colors = np.empty((camera.pixel_count if len(chroma) else 0, 3), np.float32)
    for row in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(row + _ROWS_PER_STEP, camera.height_px)
        here = slice(row * camera.width_px, last * camera.width_px)
        pixels = np.arange(here.start, here.stop, dtype=np.int64)
        means = np.empty((len(pixels), MEANS), np.float32)
        mean_of_rays(
            octree.nodes, (octree.luminance, chroma), unit, pixels, (side, float(background), octree.depth), means
        )
        luminance[here] = means[:, 0]
        if len(chroma):
            colors[here] = means[:, 1:4]
        yield Progress(last, camera.height_px, f"Sampling {side}x{side}")
    return luminance, colors


@kernel
def mean_of_rays(nodes, light, camera, pixels, sampling, means):  # type: ignore[no-untyped-def]
    """Write what side x side rays of each pixel (N,) see into `means` (N, MEANS) float32.

    light: luminance and chroma of the nodes. sampling: side, background (float), depth of the octree.

    Means are those of luminance, red, green, blue, and the share of the rays that met something. Without chroma (0, 2),
    red, green and blue are the luminance.
    """
    for run in numba.prange((len(pixels) + _RUN - 1) // _RUN):
        first = np.int64(run) * _RUN
        _mean_of_run(nodes, light, camera, pixels[first : first + _RUN], sampling, means[first : first + _RUN])


@device
def _mean_of_run(nodes, light, camera, pixels, sampling, means):  # type: ignore[no-untyped-def]
    """Write the means of some pixels; light: luminance and chroma."""
    _mean_of_pixels(nodes, light, camera, pixels, sampling, (make_tile(), make_levels(), np.empty(MEANS)), means)


@lean_device
def _mean_of_pixels(nodes, light, camera, pixels, sampling, scratch, means):  # type: ignore[no-untyped-def]
    """Trace the rays of each pixel in tiles, and write their means; sampling: side, background, depth of the octree."""
    side, background, depth = sampling
    tile, levels, sums = scratch
    search = Search(camera.side_at_0, camera.side_per_z, 1.0, COARSE, depth)
    for index in range(len(pixels)):
        row, column = pixels[index] // camera.width_px, pixels[index] % camera.width_px
        sums[:] = 0.0
        for first_j in range(0, side, TILE):
            for first_i in range(0, side, TILE):
                for k in range(TILE):
                    tile.xs[k] = 2.0 * (column + (first_i + k + 0.5) / side) / camera.width_px - 1.0
                    tile.ys[k] = 2.0 * (row + (first_j + k + 0.5) / side) / camera.height_px - 1.0
                want_pixels(tile, side - first_j, side - first_i)
                aim_tile(camera, tile)
                trace_tile(nodes, search, tile, levels)
                _add_tile(camera, tile, light, sums)
        rays = side * side
        missed = background * (rays - sums[4])
        seen = sums[0] / LUMINANCE_SCALE + missed
        means[index, 0] = seen / rays
        for channel in range(1, 4):
            means[index, channel] = (sums[channel] + missed if len(light[1]) else seen) / rays
        means[index, 4] = sums[4] / rays


@lean_device
def _add_tile(camera, tile, light, sums):  # type: ignore[no-untyped-def]
    """Add what a tile's rays have met to the sums: stored luminance, whose sum is exact, colours, and their number."""
    luminance, chroma = light
    for packet in range(PACKETS):
        left = tile.wanted[packet]
        while left != 0:
            ray = packet * LANES + first_bit(left)
            left &= left - 1
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
