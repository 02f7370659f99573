# SPDX-License-Identifier: GPL-3.0-or-later
"""Planes of a view, the inputs of the error estimator's features (methods 12.1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..octree.octree import POPCOUNT
from .pixel_buffers import PixelBuffers
from .plus.forms import CENTRE, FAR, SLOPE, Form, Plane

Pixels = slice | np.ndarray


def window_pixels(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels (9, N) int64 of the windows of pixels (N,), the lowest row first, clamped to the picture's edge."""
    row, column = np.divmod(pixels, width)
    rows = np.clip(row + np.array([-1, 0, 1])[:, None], 0, height - 1) * width  # (3, N)
    columns = np.clip(column + np.array([-1, 0, 1])[:, None], 0, width - 1)
    return (rows[:, None] + columns).reshape(9, -1)


def chosen_windows(buffers: PixelBuffers, form: Form, around: np.ndarray) -> np.ndarray:
    """Windows (C, 9, N) float32 of a form's planes about some pixels, whose neighbours are `around` (9, N).

    Planes read only at the pixels themselves are filled only there.
    """
    found = np.empty((len(form.planes), *around.shape), np.float32)
    for values, plane in zip(found, form.planes, strict=True):
        places = CENTRE if plane in form.of_pixels else slice(None)
        values[places] = _PLANES[plane](buffers, around[places])
    return found


def view_planes(buffers: PixelBuffers, planes: Sequence[Plane], first: int = 0, last: int | None = None) -> np.ndarray:
    """Planes (C, n + 2, W + 2) float32 of rows `first` to `last` - 1 of a view, n of them, with a border of one pixel.

    The border holds adjacent pixels, clamped to the picture's edge. The view must have the inputs of the planes
    (`Form.planes`).
    """
    height, width = buffers.height, buffers.width
    last = height if last is None else last
    low, high = max(first - 1, 0), min(last + 1, height)
    pixels = slice(low * width, high * width)
    found = np.empty((len(planes), last - first + 2, width + 2), np.float32)
    inside = found[:, low - first + 1 : high - first + 1]
    for index, plane in enumerate(planes):
        inside[index, :, 1:-1] = _PLANES[plane](buffers, pixels).reshape(high - low, width)
    inside[:, :, 0], inside[:, :, -1] = inside[:, :, 1], inside[:, :, -2]
    if low == first:
        found[:, 0] = found[:, 1]
    if high == last:
        found[:, -1] = found[:, -2]
    return found


def _at(values: np.ndarray, pixels: Pixels) -> np.ndarray:
    """Values of pixels; indices are in range and not checked again."""
    return values[pixels] if isinstance(pixels, slice) else values.take(pixels, axis=0, mode="clip")


def _depth(buffers: PixelBuffers, pixels: Pixels) -> np.ndarray:
    assert buffers.cube_side_world is not None
    hits = buffers.hits
    return np.where(_at(hits.node, pixels) >= 0, _at(hits.z_world, pixels) / buffers.cube_side_world, FAR)


def _per_pixel(buffers: PixelBuffers, pixels: Pixels) -> np.ndarray:
    """1 / SLOPE pixel sides, per cube side, from the voxel's side, which is the cube's / 2^level."""
    hits = buffers.hits
    return np.ldexp(np.float32(1.0 / SLOPE), _at(hits.level, pixels)) / _at(hits.ratio, pixels)


def _cosine(buffers: PixelBuffers, pixels: Pixels) -> np.ndarray:
    assert buffers.normal is not None
    return np.abs(np.einsum("...c,...c->...", buffers.normal[pixels], buffers.hits.direction[pixels]))


def _children(buffers: PixelBuffers, pixels: Pixels) -> np.ndarray:
    assert buffers.child_mask is not None
    return POPCOUNT[buffers.child_mask[pixels]] * np.float32(0.125)


def _open(buffers: PixelBuffers, pixels: Pixels) -> np.ndarray:
    assert buffers.prediction is not None and buffers.scene_luminance is not None
    coverage = buffers.prediction.coverage[pixels]
    return coverage * buffers.prediction.luminance[pixels] + (1.0 - coverage) * np.float32(buffers.scene_luminance)


def _part(name: str, *path: str | int) -> Callable[[PixelBuffers, Pixels], np.ndarray]:
    """Plane stored in a part of the view."""

    def plane(buffers: PixelBuffers, pixels: Pixels) -> np.ndarray:
        values = getattr(buffers, name)
        for step in path:
            values = values[:, step] if isinstance(step, int) else getattr(values, step)
        return _at(values, pixels)

    return plane


_PLANES: dict[Plane, Callable[[PixelBuffers, Pixels], np.ndarray]] = {
    Plane.LUMINANCE: _part("preview"),
    Plane.HIT: _part("hit"),
    Plane.DEPTH: _depth,
    Plane.PER_PIXEL: _per_pixel,
    **{Plane(Plane.NORMAL_X + axis): _part("normal", axis) for axis in range(3)},
    Plane.COSINE: _cosine,
    Plane.RATIO: _part("hits", "ratio"),
    Plane.CHILDREN: _children,
    Plane.LOOK_AHEAD: _part("prediction", "look_ahead"),
    Plane.COVERAGE: _part("prediction", "coverage"),
    Plane.PATCH: _part("prediction", "luminance"),
    Plane.BEHIND: _part("behind"),
    Plane.BEHIND_HIT: _part("behind_hit"),
    Plane.PREDICTED: _part("predicted"),
    Plane.OPEN: _open,
    Plane.FINE: _part("fine"),
    **{Plane(Plane.RAY_0 + ray): _part("fine_rays", ray) for ray in range(4)},
}
