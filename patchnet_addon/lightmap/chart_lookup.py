# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart lookup kernels: owners of texels, and values between texels that never mix two triangles."""

from __future__ import annotations

import math

import numba
import numpy as np

from ..runtime.kernels import device, kernel
from .charts import Charts
from .packing import FIRST, SECOND, SINGLE


@device
def _leg(log_side, square, kind):  # type: ignore[no-untyped-def]
    """Leg in texels: the diagonal texels of a square belong to the first of its two triangles."""
    side = float(1 << log_side)
    if square:
        return side + 0.5 if kind == FIRST else side - 0.5
    return side


@device
def _owns(i, j, leg_x, leg_y):  # type: ignore[no-untyped-def]
    """Return whether the texel (i, j), counted from the right angle, has its centre in the triangle."""
    return i >= 0 and j >= 0 and (i + 0.5) / leg_x + (j + 0.5) / leg_y < 1.0


@device
def _place(i, j, kind, page, x, y, log_width, log_height, page_side):  # type: ignore[no-untyped-def]
    """Index of the texel (i, j), counted from the right angle, among all texels."""
    if kind == SECOND:
        column = x + (1 << log_width) - 1 - i
        row = y + (1 << log_height) - 1 - j
    else:
        column = x + i
        row = y + j
    return (np.int64(page) * page_side + row) * page_side + column


@device
def _nearest(u, v, leg_x, leg_y):  # type: ignore[no-untyped-def]
    """Own texel nearest to a point (u, v) texels from the right angle, along rows."""
    last_row = math.ceil(leg_y * (1.0 - 0.5 / leg_x) - 0.5) - 1
    j = min(max(math.floor(v), 0), last_row)
    last_column = math.ceil(leg_x * (1.0 - (j + 0.5) / leg_y) - 0.5) - 1
    return min(max(math.floor(u), 0), last_column), j


@kernel
def _lookup(  # type: ignore[no-untyped-def]
    triangle, barycentric, page, x, y, log_width, log_height, kind, origin, along, page_side, texels, out
):
    channels = texels.shape[1]
    for index in numba.prange(len(triangle)):
        t = triangle[index]
        side_x = np.int64(log_width[t])
        side_y = np.int64(log_height[t])
        if kind[t] == SINGLE:
            place = _place(0, 0, kind[t], page[t], x[t], y[t], side_x, side_y, page_side)
            for channel in range(channels):
                out[index, channel] = texels[place, channel]
            continue
        leg_x = _leg(side_x, side_x == side_y, kind[t])
        leg_y = _leg(side_y, side_x == side_y, kind[t])
        b1 = barycentric[index, 0]
        b2 = barycentric[index, 1]
        upward = 3 - origin[t] - along[t]
        weight_x = b1 if along[t] == 1 else (b2 if along[t] == 2 else 1.0 - b1 - b2)
        weight_y = b1 if upward == 1 else (b2 if upward == 2 else 1.0 - b1 - b2)
        u = weight_x * leg_x
        v = weight_y * leg_y
        left = max(u - 0.5, 0.0)
        low = max(v - 0.5, 0.0)
        i = math.floor(left)
        j = math.floor(low)
        fx = left - i
        fy = low - j
        own_00 = _owns(i, j, leg_x, leg_y)
        own_10 = _owns(i + 1, j, leg_x, leg_y)
        own_01 = _owns(i, j + 1, leg_x, leg_y)
        own_11 = _owns(i + 1, j + 1, leg_x, leg_y)
        if not own_00:
            i, j = _nearest(u, v, leg_x, leg_y)
            fx = 0.0
            fy = 0.0
        at_00 = _place(i, j, kind[t], page[t], x[t], y[t], side_x, side_y, page_side)
        at_10 = _place(i + 1, j, kind[t], page[t], x[t], y[t], side_x, side_y, page_side)
        at_01 = _place(i, j + 1, kind[t], page[t], x[t], y[t], side_x, side_y, page_side)
        at_11 = _place(i + 1, j + 1, kind[t], page[t], x[t], y[t], side_x, side_y, page_side)
        for channel in range(channels):
            value_00 = texels[at_00, channel]
            value_10 = texels[at_10, channel] if own_10 and fx > 0.0 else value_00
            value_01 = texels[at_01, channel] if own_01 and fy > 0.0 else value_00
            if own_11 and fx > 0.0 and fy > 0.0:
                value_11 = texels[at_11, channel]
            else:  # beyond the hypotenuse: the plane through the other three
                value_11 = max(value_10 + value_01 - value_00, 0.0)
            near = value_00 + fx * (value_10 - value_00)
            far = value_01 + fx * (value_11 - value_01)
            out[index, channel] = near + fy * (far - near)


def lookup(charts: Charts, texels: np.ndarray, triangles: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Values (F, C) float32 at points of triangles, bilinear between the triangle's own texels.

    texels: (pages * side * side, C) float32. triangles: (F,) int64. barycentric: (F, 2), weights of corners 1 and 2.
    Within half a texel of the legs the value is that of the nearest texels; along the hypotenuse it is extrapolated.
    """
    out = np.empty((len(triangles), texels.shape[1]), np.float32)
    _lookup(
        triangles, barycentric, charts.page, charts.x, charts.y, charts.log_width, charts.log_height, charts.kind,
        charts.origin, charts.along, charts.page_side, texels, out,
    )  # fmt: skip
    return out


@kernel
def _means(triangle, page, x, y, log_width, log_height, kind, page_side, texels, out):  # type: ignore[no-untyped-def]
    channels = texels.shape[1]
    for index in numba.prange(len(triangle)):
        t = triangle[index]
        side_x = np.int64(log_width[t])
        side_y = np.int64(log_height[t])
        single = kind[t] == SINGLE
        leg_x = 2.0 if single else _leg(side_x, side_x == side_y, kind[t])
        leg_y = 2.0 if single else _leg(side_y, side_x == side_y, kind[t])
        count = 0
        out[index] = 0.0
        j = 0
        while _owns(0, j, leg_x, leg_y):
            i = 0
            while _owns(i, j, leg_x, leg_y):
                place = _place(i, j, kind[t], page[t], x[t], y[t], side_x, side_y, page_side)
                for channel in range(channels):
                    out[index, channel] += texels[place, channel]
                count += 1
                i += 1
                if single:
                    break
            j += 1
            if single:
                break
        for channel in range(channels):
            out[index, channel] /= count


def triangle_means(charts: Charts, texels: np.ndarray, triangles: np.ndarray, page: int | None = None) -> np.ndarray:
    """Means (n, C) float64 over the own texels of each of the triangles (n,).

    texels: (pages * side * side, C) float32, or those of one `page` (side * side, C) on which all triangles lie.
    """
    out = np.empty((len(triangles), texels.shape[1]), np.float64)
    pages = charts.page if page is None else np.zeros_like(charts.page)
    _means(
        triangles, pages, charts.x, charts.y, charts.log_width, charts.log_height, charts.kind,
        charts.page_side, texels, out,
    )  # fmt: skip
    return out


def group_means(charts: Charts, texels: np.ndarray, triangles: np.ndarray, page: int | None = None) -> np.ndarray:
    """Average as `triangle_means`, but triangles that share paths (`crowding`) get the mean of those of them given."""
    means = triangle_means(charts, texels, triangles, page)
    if charts.group is None or not len(triangles):
        return means
    _, place, count = np.unique(charts.group[triangles], return_inverse=True, return_counts=True)
    place = place.reshape(-1)
    sums = [np.bincount(place, means[:, channel]) for channel in range(means.shape[1])]
    shared: np.ndarray = (np.stack(sums, axis=-1) / count[:, None])[place]
    return shared


@kernel
def _owners(triangle, x, y, log_width, log_height, kind, page_side, out):  # type: ignore[no-untyped-def]
    for index in numba.prange(len(triangle)):
        t = triangle[index]
        side_x = np.int64(log_width[t])
        side_y = np.int64(log_height[t])
        if kind[t] == SINGLE:
            out[_place(0, 0, kind[t], 0, x[t], y[t], side_x, side_y, page_side)] = t
            continue
        leg_x = _leg(side_x, side_x == side_y, kind[t])
        leg_y = _leg(side_y, side_x == side_y, kind[t])
        j = 0
        while _owns(0, j, leg_x, leg_y):
            i = 0
            while _owns(i, j, leg_x, leg_y):
                out[_place(i, j, kind[t], 0, x[t], y[t], side_x, side_y, page_side)] = t
                i += 1
            j += 1


def texel_owners(charts: Charts, page: int) -> np.ndarray:
    """Triangle (side * side,) int32 to which each texel of a page belongs, -1 for none."""
    out = np.full(charts.page_side**2, -1, np.int32)
    _owners(
        np.flatnonzero(charts.page == page), charts.x, charts.y, charts.log_width, charts.log_height, charts.kind,
        charts.page_side, out,
    )  # fmt: skip
    return out
