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
from .camera import Camera, CameraUnit, camera_in_unit_cube
from .traverse import first_seen, pixel_ray

MAX_SAMPLES = int(RAYS.high)  # per pixel side
NO_CHROMA = np.empty((0, 2), np.uint8)
_ROWS_PER_STEP = 8


def finer_rays(octree: Octree, camera: Camera, samples: int) -> tuple[CameraUnit, np.ndarray]:
    """Camera in the octree's cube, and the lens of rays that have the footprint pixel / samples.

    Raises SettingError for sample counts outside 1 to MAX_SAMPLES.
    """
    RAYS.check(samples)
    unit = camera_in_unit_cube(camera, octree.grid)
    lens = unit.lens.copy()
    lens[2:4] /= samples
    return unit, lens


def supersample(
    octree: Octree, camera: Camera, samples: int = MAX_SAMPLES, background: float = 0.0, *, same_lod: bool = False
) -> Steps[np.ndarray]:
    """Luminance (P,) float32, the mean of samples x samples rays per pixel at regular sub-pixel centres (methods 7.5).

    Each ray has the footprint pixel / samples, i.e. up to log2(samples) levels deeper; same_lod keeps the pixel's own.
    """
    steps = _supersampled(octree, NO_CHROMA, camera, samples, background, same_lod)
    return (yield from steps)[0]


def supersample_colors(
    octree: Octree, camera: Camera, samples: int = MAX_SAMPLES, background: float = 0.0
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Luminance (P,) as of `supersample`, and the mean linear colours (P, 3) float32; the octree must have colour."""
    assert octree.chroma is not None
    return (yield from _supersampled(octree, octree.chroma, camera, samples, background, same_lod=False))


def _supersampled(
    octree: Octree, chroma: np.ndarray, camera: Camera, samples: int, background: float, same_lod: bool
) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Luminance (P,), and colours (P, 3) unless `chroma` is empty."""
    unit, lens = finer_rays(octree, camera, samples)
    if same_lod:
        lens = unit.lens
    out = np.empty(camera.pixel_count, np.float32)
    colors = np.empty((camera.pixel_count if len(chroma) else 0, 3), np.float32)
    for row in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(row + _ROWS_PER_STEP, camera.height_px)
        _supersample(
            octree.child_mask, octree.first_child, octree.luminance, chroma, unit.frame, lens, unit.perspective,
            unit.width_px, unit.height_px, row, last, samples, np.float64(background), out, colors,
        )  # fmt: skip
        yield Progress(last, camera.height_px, f"Sampling {samples}x{samples}")
    return out, colors


@kernel
def _supersample(  # type: ignore[no-untyped-def]
    child_mask, first_child, luminance, chroma, frame, lens, perspective, width, height, first, last, samples,
    background, out, colors,
):  # fmt: skip
    for index in numba.prange((last - first) * width):
        row = first + index // width
        column = index % width
        stack = np.empty(MAX_LEVELS, np.int64)
        found = np.empty(3, np.int64)
        ray_o = np.empty(3, np.float64)
        ray_d = np.empty(3, np.float64)
        total = 0.0
        red = 0.0
        green = 0.0
        blue = 0.0
        for j in range(samples):
            y = 2.0 * (row + (j + 0.5) / samples) / height - 1.0
            for i in range(samples):
                x = 2.0 * (column + (i + 0.5) / samples) / width - 1.0
                speed = pixel_ray(frame, lens, perspective, x, y, ray_o, ray_d)
                hit, _, _ = first_seen(child_mask, first_child, ray_o, ray_d, speed, lens, 1.0, stack, found)
                shine = luminance[hit] / LUMINANCE_SCALE if hit >= 0 else background
                total += shine
                if len(chroma):
                    if hit >= 0:
                        r, g, b = decode_color(shine, chroma[hit, 0], chroma[hit, 1])
                    else:
                        r, g, b = background, background, background
                    red += r
                    green += g
                    blue += b
        out[row * width + column] = total / (samples * samples)
        if len(chroma):
            colors[row * width + column, 0] = red / (samples * samples)
            colors[row * width + column, 1] = green / (samples * samples)
            colors[row * width + column, 2] = blue / (samples * samples)
