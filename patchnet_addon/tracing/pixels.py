# SPDX-License-Identifier: GPL-3.0-or-later
"""Super-sampling of chosen pixels, so that refining some costs what these cost (methods 7.5)."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from ..cells.contract import MAX_LEVELS
from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.kernels import kernel
from ..surface.chroma_kernels import decode_color
from .camera import Camera
from .supersample import MAX_SAMPLES, NO_CHROMA, finer_rays
from .traverse import first_seen, pixel_ray


@dataclass(frozen=True, eq=False)
class Samples:
    """Means over samples x samples rays of N pixels, over a black background.

    luminance: (N,) float32, as `supersample` computes it. colors: (N, 3) float32 linear, gray without colour.
    coverage: (N,) float32, share of the rays that met something.
    """

    luminance: np.ndarray
    colors: np.ndarray
    coverage: np.ndarray


def supersample_pixels(octree: Octree, camera: Camera, pixels: np.ndarray, samples: int = MAX_SAMPLES) -> Samples:
    """Pixels (N,) of `camera`, by their indices row * width + column, with samples x samples rays each.

    Each ray has the footprint pixel / samples. Raises SettingError for sample counts outside 1 to 32.
    """
    unit, lens = finer_rays(octree, camera, samples)
    chroma = NO_CHROMA if octree.chroma is None else octree.chroma
    means = np.empty((len(pixels), 5), np.float32)  # luminance, red, green, blue, coverage
    _supersample_pixels(
        octree.child_mask, octree.first_child, octree.luminance, chroma, unit.frame, lens, unit.perspective,
        unit.width_px, unit.height_px, np.asarray(pixels, np.int64), samples, means,
    )  # fmt: skip
    return Samples(means[:, 0].copy(), means[:, 1:4].copy(), means[:, 4].copy())


@kernel
def _supersample_pixels(  # type: ignore[no-untyped-def]
    child_mask, first_child, luminance, chroma, frame, lens, perspective, width, height, pixels, samples, means
):
    for index in numba.prange(len(pixels)):
        row = pixels[index] // width
        column = pixels[index] % width
        stack = np.empty(MAX_LEVELS, np.int64)
        found = np.empty(3, np.int64)
        ray_o = np.empty(3, np.float64)
        ray_d = np.empty(3, np.float64)
        total = np.zeros(5, np.float64)
        for j in range(samples):
            y = 2.0 * (row + (j + 0.5) / samples) / height - 1.0
            for i in range(samples):
                x = 2.0 * (column + (i + 0.5) / samples) / width - 1.0
                speed = pixel_ray(frame, lens, perspective, x, y, ray_o, ray_d)
                hit, _, _ = first_seen(child_mask, first_child, ray_o, ray_d, speed, lens, 1.0, stack, found)
                if hit < 0:
                    continue
                shine = luminance[hit] / LUMINANCE_SCALE
                total[0] += shine
                total[4] += 1.0
                if len(chroma):
                    red, green, blue = decode_color(shine, chroma[hit, 0], chroma[hit, 1])
                    total[1] += red
                    total[2] += green
                    total[3] += blue
        if len(chroma) == 0:
            total[1:4] = total[0]
        for channel in range(5):
            means[index, channel] = total[channel] / (samples * samples)
