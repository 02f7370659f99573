# SPDX-License-Identifier: GPL-3.0-or-later
"""Super-sampled pictures of an octree (methods 7.5), (H * W,) with row 0 at the bottom."""

from __future__ import annotations

import numba
import numpy as np

from ..cells.contract import MAX_LEVELS
from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.bounds import RAYS
from ..runtime.kernels import kernel
from ..runtime.progress import Progress, Steps
from ..surface.chroma_kernels import decode_color
from .camera import Camera, camera_in_unit_cube
from .traverse import first_seen, pixel_ray

MAX_SIDE = int(RAYS.high)  # per pixel side
NO_CHROMA = np.empty((0, 2), np.uint8)
MEANS = 5  # luminance, red, green, blue, coverage
_ROWS_PER_STEP = 8


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
        mean_of_rays(octree.nodes, octree.luminance, chroma, unit, pixels, side, np.float64(background), means)
        luminance[here] = means[:, 0]
        if len(chroma):
            colors[here] = means[:, 1:4]
        yield Progress(last, camera.height_px, f"Sampling {side}x{side}")
    return luminance, colors


@kernel
def mean_of_rays(nodes, luminance, chroma, camera, pixels, side, background, means):  # type: ignore[no-untyped-def]
    """Write what side x side rays of each pixel (N,) see into `means` (N, MEANS) float32.

    Means are those of luminance, red, green, blue, and the share of the rays that met something. Without chroma (0, 2),
    red, green and blue are the luminance.
    """
    for index in numba.prange(len(pixels)):
        row = pixels[index] // camera.width_px
        column = pixels[index] % camera.width_px
        stack = np.empty(MAX_LEVELS, np.int64)
        total = 0.0
        red = 0.0
        green = 0.0
        blue = 0.0
        met = 0
        for j in range(side):
            y = 2.0 * (row + (j + 0.5) / side) / camera.height_px - 1.0
            for i in range(side):
                x = 2.0 * (column + (i + 0.5) / side) / camera.width_px - 1.0
                node = first_seen(nodes, camera, pixel_ray(camera, x, y), 1.0, stack).node
                met += node >= 0
                seen = luminance[node] / LUMINANCE_SCALE if node >= 0 else background
                total += seen
                if len(chroma):
                    if node >= 0:
                        r, g, b = decode_color(seen, chroma[node, 0], chroma[node, 1])
                    else:
                        r, g, b = background, background, background
                    red += r
                    green += g
                    blue += b
        if len(chroma) == 0:
            red, green, blue = total, total, total
        means[index, 0] = total / (side * side)
        means[index, 1] = red / (side * side)
        means[index, 2] = green / (side * side)
        means[index, 3] = blue / (side * side)
        means[index, 4] = met / (side * side)
