# SPDX-License-Identifier: GPL-3.0-or-later
"""Film of a picture: colours and coverage of its pixels through a pixel filter (methods 7.5b).

Rays of a pixel give shares to those around it; more rays replace what fewer gave. Sums are integers, so that it can be
taken back to the last bit, and neither order nor threads matter. Beyond its edge there is nothing: pixels there weigh
what is inside.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..octree.octree import Octree
from ..runtime.kernels import device, kernel
from ..runtime.progress import Progress, Steps
from ..runtime.threads import run_parts
from ..tracing.camera import Camera
from ..tracing.pixel_filter import GRID, PixelFilter, RayPattern
from ..tracing.pixel_means import PixelMeans
from ..tracing.supersample import MAX_SIDE, SpreadPixels, spread_pixels

CHANNELS = 4  # red, green, blue, coverage
_ONE = 2.0**32  # of the sums
_MOST = 1e9
_SHARES_AT_ONCE = 1 << 20  # a wide filter has hundreds of pixels around each
_ROWS_PER_STEP = 8


class _Frame(NamedTuple):
    """Factors on columns (W,) and rows (H,) of a picture, since nothing is beyond, and the filter's radius."""

    scale_x: np.ndarray
    scale_y: np.ndarray
    radius: int


class Film:
    """Picture of P = height x width pixels, row 0 at the bottom.

    values: (P, 4) float32, linear colours premultiplied by coverage, and coverage, filtered.
    """

    def __init__(
        self, size_px: tuple[int, int], pixel_filter: PixelFilter, zeros: Callable[..., np.ndarray] = np.zeros
    ) -> None:
        """Begin with a black picture of (width, height); zeros: makes its values."""
        self.pixel_filter, self._width = pixel_filter, size_px[0]
        shape = size_px[0] * size_px[1], CHANNELS
        self.values: np.ndarray = zeros(shape, np.float32)
        self._single, self._sums = np.zeros(shape, np.float32), np.zeros(shape, np.int64)
        radius, shares = pixel_filter.radius, pixel_filter.shares()
        self._shares = np.outer(shares, shares).ravel().astype(np.float32)
        x, y = (1.0 / np.convolve(np.ones(side), shares)[radius : radius + side] for side in size_px)
        self._frame = _Frame(x, y, radius)

    def show(self, first: int, single: np.ndarray) -> None:
        """Show pixels from index `first` on with one ray (n, 4) each."""
        shown, rows = self._single[first : first + len(single)], len(self._frame.scale_y)
        run_parts(_show, rows, first, shown, single, self._shares, self._frame, self._sums, self.values)
        shown[:] = single

    def trace(
        self, octree: Octree, camera: Camera, pixels: np.ndarray, samples: np.ndarray, side: int, pattern: RayPattern
    ) -> np.ndarray:
        """Trace side x side rays of pixels (n,) in place of the `samples` (n,) that each has shown of that pattern.

        Returns plain means (n,) float32 of their luminances.
        """
        luminance = np.empty(len(pixels), np.float32)
        most = max(_SHARES_AT_ONCE // len(self._shares), 1)
        for count in np.unique(samples):
            alike = np.flatnonzero(samples == count)
            for mine in (alike[first : first + most] for first in range(0, len(alike), most)):
                before = self._given(octree, camera, pixels[mine], math.isqrt(count), pattern).given
                after, luminance[mine] = self._given(octree, camera, pixels[mine], side, pattern)
                self.replace(pixels[mine], before, after)
        return luminance

    def _given(
        self, octree: Octree, camera: Camera, pixels: np.ndarray, side: int, pattern: RayPattern
    ) -> SpreadPixels:
        if side == 1:
            return SpreadPixels(self.given(pixels), np.zeros(len(pixels), np.float32))
        finer = max(side, pattern.footprints)
        return spread_pixels(octree, camera, pixels, pattern.places(side), self.pixel_filter, finer=finer)

    def given(self, pixels: np.ndarray) -> np.ndarray:
        """What single rays of pixels (n,) give to the K around each: (n, K, 4) float32, as in `spread_pixels`."""
        return self._single[pixels][:, None] * self._shares[:, None]

    def replace(self, pixels: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        """Replace what pixels (n,) have given to those around them (n, K, 4)."""
        rows = len(self._frame.scale_y)
        run_parts(_replace, rows, pixels, before, after, self._frame, self._sums, self.values)


def filtered(octree: Octree, camera: Camera, pixel_filter: PixelFilter) -> Steps[PixelMeans]:
    """All pixels by MAX_SIDE x MAX_SIDE rays: colours and coverage through a filter, plain means of luminance."""
    film = Film((camera.width_px, camera.height_px), pixel_filter)
    luminance = np.empty(camera.pixel_count, np.float32)
    for first in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(first + _ROWS_PER_STEP, camera.height_px)
        pixels = np.arange(first * camera.width_px, last * camera.width_px)
        luminance[pixels] = film.trace(octree, camera, pixels, np.ones(len(pixels), np.int32), MAX_SIDE, GRID)
        yield Progress(last, camera.height_px, f"Sampling {MAX_SIDE}x{MAX_SIDE}")
    return PixelMeans(luminance, film.values[:, :3], film.values[:, 3])


@kernel
def _show(
    first: int, last: int, start: int, before: np.ndarray, after: np.ndarray, shares: np.ndarray, frame: _Frame,
    sums: np.ndarray, values: np.ndarray,
) -> None:  # fmt: skip
    """Replace what single rays of pixels from `start` on give to some rows of the picture."""
    scale_x, scale_y, radius = frame
    width = len(scale_x)
    low, high = start // width - radius, (start + len(after) - 1) // width + radius
    for y in range(max(first, low), min(last, high + 1)):
        for x in range(width):
            here, scale = y * width + x, scale_y[y] * scale_x[x]
            red = green = blue = covered = np.int64(0)
            around = len(shares) - 1  # of the pixel that is seen from `here`, in whose turn this one is opposite
            for row in range(y - radius, y + radius + 1):
                for column in range(x - radius, x + radius + 1):
                    at = row * width + column - start
                    if 0 <= column < width and 0 <= at < len(after):
                        share = shares[around]
                        red += _change(scale, share * before[at, 0], share * after[at, 0])
                        green += _change(scale, share * before[at, 1], share * after[at, 1])
                        blue += _change(scale, share * before[at, 2], share * after[at, 2])
                        covered += _change(scale, share * before[at, 3], share * after[at, 3])
                    around -= 1
            _add(sums[here], values[here], (red, green, blue, covered))


@kernel
def _replace(
    first: int, last: int, pixels: np.ndarray, before: np.ndarray, after: np.ndarray, frame: _Frame, sums: np.ndarray,
    values: np.ndarray,
) -> None:  # fmt: skip
    """Replace what pixels give to some rows of the picture."""
    scale_x, scale_y, radius = frame
    width = len(scale_x)
    for at in range(len(pixels)):
        row = pixels[at] // width
        column = pixels[at] - row * width
        around = 0
        for y in range(row - radius, row + radius + 1):
            for x in range(column - radius, column + radius + 1):
                if first <= y < last and 0 <= x < width:
                    here, scale = y * width + x, scale_y[y] * scale_x[x]
                    then, now = before[at, around], after[at, around]
                    red, green = _change(scale, then[0], now[0]), _change(scale, then[1], now[1])
                    blue, covered = _change(scale, then[2], now[2]), _change(scale, then[3], now[3])
                    _add(sums[here], values[here], (red, green, blue, covered))
                around += 1


@device
def _change(scale, before, after):
    return _whole(scale * after) - _whole(scale * before)


@device
def _whole(value):
    return np.int64((value if value < _MOST else _MOST) * _ONE)


@device
def _add(sums, values, change):
    for channel in range(CHANNELS):
        sums[channel] += change[channel]
        values[channel] = sums[channel] * (1.0 / _ONE)
