# SPDX-License-Identifier: GPL-3.0-or-later
"""Planes of a view, the inputs of the error estimator's features (methods 12.1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..cells.morton import POPCOUNT
from .pixel_buffers import PixelBuffers
from .plus.compiled import estimate
from .plus.forms import FAR, SLOPE, Form, Plane
from .plus.weights import Estimators


def estimated_error(buffers: PixelBuffers, estimators: Estimators, form: Form) -> np.ndarray:
    """Expected error (P,) float32 of the picture `form.shown` in the active pixels of a view; 0 elsewhere.

    The view must have the inputs of the form's planes.
    """

    def planes_of(first: int, last: int) -> np.ndarray:
        return view_planes(buffers, form.planes, first, last)

    return estimate(planes_of, buffers.picture(buffers.active), estimators, form).ravel()


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


def _depth(buffers: PixelBuffers, pixels: slice) -> np.ndarray:
    assert buffers.cube_side_world is not None
    hits = buffers.hits
    return np.where(hits.node[pixels] >= 0, hits.z_world[pixels] / buffers.cube_side_world, FAR)


def _per_pixel(buffers: PixelBuffers, pixels: slice) -> np.ndarray:
    """1 / SLOPE pixel sides, per cube side, from the voxel's side, which is the cube's / 2^level."""
    hits = buffers.hits
    return np.ldexp(np.float32(1.0 / SLOPE), hits.level[pixels]) / hits.ratio[pixels]


def _cosine(buffers: PixelBuffers, pixels: slice) -> np.ndarray:
    assert buffers.normal is not None
    return np.abs(np.einsum("...c,...c->...", buffers.normal[pixels], buffers.hits.direction[pixels]))


def _children(buffers: PixelBuffers, pixels: slice) -> np.ndarray:
    assert buffers.child_mask is not None
    return POPCOUNT[buffers.child_mask[pixels]] * np.float32(0.125)


def _open(buffers: PixelBuffers, pixels: slice) -> np.ndarray:
    assert buffers.prediction is not None and buffers.scene_luminance is not None
    coverage = buffers.prediction.coverage[pixels]
    return coverage * buffers.prediction.luminance[pixels] + (1.0 - coverage) * np.float32(buffers.scene_luminance)


def _part(name: str, *path: str | int) -> Callable[[PixelBuffers, slice], np.ndarray]:
    """Plane stored in a part of the view."""

    def plane(buffers: PixelBuffers, pixels: slice) -> np.ndarray:
        values = getattr(buffers, name)
        for step in path:
            values = values[:, step] if isinstance(step, int) else getattr(values, step)
        return values[pixels]

    return plane


_PLANES: dict[Plane, Callable[[PixelBuffers, slice], np.ndarray]] = {
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
