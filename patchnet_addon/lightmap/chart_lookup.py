# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart lookup kernels: owners of texels, and interpolation that never mixes two triangles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .charts import Charts
from .packing import SECOND, SINGLE


class _Rectangles(NamedTuple):
    """Rectangles of all charts, the triangles' halves of them and their corners, for kernels; shapes as in `Charts`."""

    x: np.ndarray
    y: np.ndarray
    log_width: np.ndarray
    log_height: np.ndarray
    kind: np.ndarray
    origin: np.ndarray
    along: np.ndarray
    legs: np.ndarray
    page_side: int

    @classmethod
    def of_charts(cls, charts: Charts) -> _Rectangles:
        return cls(*(getattr(charts, name) for name in cls._fields))


class _Half(NamedTuple):
    """Half of a rectangle that belongs to one triangle, on a page of `page_side` texels; legs in texels."""

    x: int
    y: int
    log_width: np.int64
    log_height: np.int64
    kind: int
    leg_x: float
    leg_y: float
    page_side: int


@device
def _half(rectangles, t):  # type: ignore[no-untyped-def]
    """Half that belongs to the triangle t."""
    width, height = np.int64(rectangles.log_width[t]), np.int64(rectangles.log_height[t])
    leg_x, leg_y = float(rectangles.legs[t, 0]), float(rectangles.legs[t, 1])
    return _Half(
        rectangles.x[t], rectangles.y[t], width, height, rectangles.kind[t], leg_x, leg_y, rectangles.page_side
    )


@device
def _owns(half, i, j):  # type: ignore[no-untyped-def]
    """Return whether the texel (i, j), counted from the right angle, has its centre in the triangle."""
    return i >= 0 and j >= 0 and (i + 0.5) / half.leg_x + (j + 0.5) / half.leg_y < 1.0


@device
def _texel_index(half, page, i, j):  # type: ignore[no-untyped-def]
    """Index of the texel (i, j) of a half, counted from the right angle, among the texels of all pages."""
    if half.kind == SECOND:
        column = half.x + (1 << half.log_width) - 1 - i
        row = half.y + (1 << half.log_height) - 1 - j
    else:
        column = half.x + i
        row = half.y + j
    return (np.int64(page) * half.page_side + row) * half.page_side + column


@device
def _nearest(half, u, v):  # type: ignore[no-untyped-def]
    """Own texel nearest to a point (u, v) texels from the right angle, along rows."""
    last_row = math.ceil(half.leg_y * (1.0 - 0.5 / half.leg_x) - 0.5) - 1
    j = min(max(math.floor(v), 0), last_row)
    last_column = math.ceil(half.leg_x * (1.0 - (j + 0.5) / half.leg_y) - 0.5) - 1
    return min(max(math.floor(u), 0), last_column), j


@kernel
def _lookup(first, last, places, pages, rectangles, texels, out):  # type: ignore[no-untyped-def]
    triangle, barycentric = places
    channels = texels.shape[1]
    origin, along = rectangles.origin, rectangles.along
    for index in range(first, last):
        t = triangle[index]
        half = _half(rectangles, t)
        page = pages[t]
        if half.kind == SINGLE:
            texel = _texel_index(half, page, 0, 0)
            for channel in range(channels):
                out[index, channel] = texels[texel, channel]
            continue
        b1 = barycentric[index, 0]
        b2 = barycentric[index, 1]
        upward = 3 - origin[t] - along[t]
        weight_x = b1 if along[t] == 1 else (b2 if along[t] == 2 else 1.0 - b1 - b2)
        weight_y = b1 if upward == 1 else (b2 if upward == 2 else 1.0 - b1 - b2)
        u = weight_x * half.leg_x
        v = weight_y * half.leg_y
        left = max(u - 0.5, 0.0)
        low = max(v - 0.5, 0.0)
        i = math.floor(left)
        j = math.floor(low)
        fx = left - i
        fy = low - j
        own_00 = _owns(half, i, j)
        own_10 = _owns(half, i + 1, j)
        own_01 = _owns(half, i, j + 1)
        own_11 = _owns(half, i + 1, j + 1)
        if not own_00:
            i, j = _nearest(half, u, v)
            fx = 0.0
            fy = 0.0
        at_00 = _texel_index(half, page, i, j)
        at_10 = _texel_index(half, page, i + 1, j)
        at_01 = _texel_index(half, page, i, j + 1)
        at_11 = _texel_index(half, page, i + 1, j + 1)
        for channel in range(channels):
            value_00 = texels[at_00, channel]
            value_10 = texels[at_10, channel] if own_10 and fx > 0.0 else value_00
            value_01 = texels[at_01, channel] if own_01 and fy > 0.0 else value_00
            if own_11 and fx > 0.0 and fy > 0.0:
                value_11 = texels[at_11, channel]
            else:  # beyond the hypotenuse: extrapolate from the plane of the other three
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
    rectangles = _Rectangles.of_charts(charts)
    run_parts(_lookup, len(triangles), (triangles, barycentric), charts.page, rectangles, texels, out)
    return out


@kernel
def _means(first, last, triangle, pages, rectangles, texels, out):  # type: ignore[no-untyped-def]
    channels = texels.shape[1]
    for index in range(first, last):
        half = _half(rectangles, triangle[index])
        page = pages[triangle[index]]
        count = 0
        out[index] = 0.0
        j = 0
        while _owns(half, 0, j):
            i = 0
            while _owns(half, i, j):
                texel = _texel_index(half, page, i, j)
                for channel in range(channels):
                    out[index, channel] += texels[texel, channel]
                count += 1
                i += 1
            j += 1
        for channel in range(channels):
            out[index, channel] /= count


def triangle_means(charts: Charts, texels: np.ndarray, triangles: np.ndarray, page: int | None = None) -> np.ndarray:
    """Means (n, C) float64 over the own texels of each of the triangles (n,).

    texels: (pages * side * side, C) float32, or those of one `page` (side * side, C) on which all triangles lie.
    """
    out = np.empty((len(triangles), texels.shape[1]), np.float64)
    pages = charts.page if page is None else np.zeros_like(charts.page)
    run_parts(_means, len(triangles), triangles, pages, _Rectangles.of_charts(charts), texels, out)
    return out


def group_means(charts: Charts, texels: np.ndarray, triangles: np.ndarray, page: int | None = None) -> np.ndarray:
    """Average as `triangle_means`, but triangles that share paths (`crowding`) get the mean over their group."""
    means = triangle_means(charts, texels, triangles, page)
    if charts.group is None or not len(triangles):
        return means
    _, inverse, count = np.unique(charts.group[triangles], return_inverse=True, return_counts=True)
    inverse = inverse.reshape(-1)
    sums = [np.bincount(inverse, means[:, channel]) for channel in range(means.shape[1])]
    shared: np.ndarray = (np.stack(sums, axis=-1) / count[:, None])[inverse]
    return shared


@kernel
def _owners(first, last, triangle, rectangles, out):  # type: ignore[no-untyped-def]
    for index in range(first, last):
        t = triangle[index]
        half = _half(rectangles, t)
        j = 0
        while _owns(half, 0, j):
            i = 0
            while _owns(half, i, j):
                out[_texel_index(half, 0, i, j)] = t
                i += 1
            j += 1


def texel_owners(charts: Charts, page: int) -> np.ndarray:
    """Triangle (side * side,) int32 that owns each texel of a page, -1 for none."""
    out = np.full(charts.page_side**2, -1, np.int32)
    here = np.flatnonzero(charts.page == page)
    run_parts(_owners, len(here), here, _Rectangles.of_charts(charts), out)
    return out
