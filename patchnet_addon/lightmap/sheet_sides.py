# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets of a surface, their sides that get light, and the points that measure it (methods 7.2f).

Light on both sides is measured at points spread over the sheet by area.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_ENCLOSED = 0.02  # of the other side's light, and of the median: that side is not meant to be seen
_DARK = 1e-3  # of the brightest side: both sides are black
_BLACK = 1e-6  # of it: no light at all
MOST_SHEETS = 512
_POINTS, _FEWEST, _MOST = 2048, 4, 32  # of all sheets, of one at least and at most
_STEPS = 0.7548776662466927, 0.5698402909980532  # of points in a triangle: powers of 1 / the plastic number


def connected(pairs: np.ndarray, count: int) -> np.ndarray:
    """Smallest member of the connected component of each of `count` items; those of a pair (N, 2) are connected."""
    root = np.arange(count)
    while len(pairs):
        pairs = root[pairs]
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        np.minimum.at(root, pairs.max(axis=1), pairs.min(axis=1))
        while (root[root] != root).any():
            root = root[root]
    return root


def sheets_of(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T,) int32, number of each triangle's sheet, and (S,) bool, whether the sheet is open: it has a boundary.

    vertices: (V, 3), equal positions count as one, so that seams of UV maps divide no sheet. triangles: (T, 3) int32.
    Two triangles belong to one sheet if they alone share an edge, with opposite directions along it; an edge of three
    triangles, or of two with equal directions, is a boundary. So normals of a sheet are flipped together or not at all.
    Triangles of zero area belong to none, -1.
    """
    _, place = np.unique(np.ascontiguousarray(vertices).view([("", vertices.dtype)] * 3).ravel(), return_inverse=True)
    corners = place.reshape(-1)[triangles].astype(np.int64)  # (T, 3)
    distinct = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    start, end = corners[distinct].ravel(), np.roll(corners[distinct], -1, axis=1).ravel()
    key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    edges, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    turns = np.bincount(edge, np.where(start < end, 1.0, -1.0), len(edges))
    matched = ((uses == 2) & (turns == 0.0))[edge]
    inner = np.flatnonzero(matched)
    inner = inner[np.argsort(edge[inner], kind="stable")]
    root = connected((inner // 3).reshape(-1, 2), len(start) // 3)  # both triangles of each edge
    roots, number = np.unique(root, return_inverse=True)
    result = np.full(len(triangles), -1, np.int32)
    result[distinct] = number.reshape(-1)
    is_open = np.zeros(len(roots), bool)
    is_open[number.reshape(-1)[~matched.reshape(-1, 3).all(axis=1)]] = True
    return result, is_open


class SheetPoints(NamedTuple):
    """Points on sheets. triangle: (P,) int64. barycentric: (P, 2) weights of corners 1 and 2. sheet: (P,) int64."""

    triangle: np.ndarray
    barycentric: np.ndarray
    sheet: np.ndarray


def asked_sheets(areas: np.ndarray) -> np.ndarray:
    """Sheets (N,) int64 of S to be measured: the largest ones, at most MOST_SHEETS.

    areas: (S,), 0 excludes a sheet.
    """
    order = np.argsort(-areas, kind="stable")[:MOST_SHEETS]
    return order[areas[order] > 0.0]


def points_on_sheets(asked: np.ndarray, sheet: np.ndarray, areas: np.ndarray) -> SheetPoints:
    """Spread points over sheets (N,) by area, the same number on each, deterministically.

    sheet: (T,) of each triangle, -1 for none. areas: (T,) of triangles, 0 for those that get no point.
    """
    if not len(asked):
        return SheetPoints(np.empty(0, np.int64), np.empty((0, 2)), np.empty(0, np.int64))
    count = int(np.clip(_POINTS // len(asked), _FEWEST, _MOST))
    rank = np.full(int(max(sheet.max(initial=-1), asked.max())) + 2, -1, np.int64)  # the last one: -1
    rank[asked] = np.arange(len(asked))
    triangles = np.flatnonzero((rank[sheet] >= 0) & (areas > 0.0))
    triangles = triangles[np.argsort(rank[sheet[triangles]], kind="stable")]
    ends = np.cumsum(areas[triangles], dtype=np.float64)
    last = np.searchsorted(rank[sheet[triangles]], np.arange(len(asked)), side="right")
    upper = ends[last - 1]
    lower = np.concatenate([[0.0], upper[:-1]])
    share = (np.arange(count) + 0.5) / count
    places = (lower[:, None] + share * (upper - lower)[:, None]).ravel()
    chosen = np.minimum(np.searchsorted(ends, places), np.repeat(last - 1, count))
    steps = np.arange(1, len(chosen) + 1)[:, None] * np.array(_STEPS) % 1.0
    folded = np.where(steps.sum(axis=1, keepdims=True) > 1.0, 1.0 - steps, steps)
    return SheetPoints(triangles[chosen], folded, np.repeat(asked, count))


def lit_sides(light: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """(N,) int8, sides of sheets that get light: 1 the front, -1 the back, 0 both.

    light: (N, 2) on front and back, means over the sheet. areas: (N,).
    A side is dark if it gets next to nothing compared with the other; a front must also get next to nothing compared
    with other fronts: a lampshade's front is not dark because of the lamp inside.
    """
    front, back = light[:, 0], light[:, 1]
    brightest = float(light.max(initial=0.0))
    lit = back > np.maximum(_DARK * brightest, _ENCLOSED * front)
    enclosed = (front < _ENCLOSED * back) & (front <= _ENCLOSED * _usual(front, areas, _BLACK * brightest))
    return np.where(lit & enclosed, -1, np.where(lit, 0, 1)).astype(np.int8)


def _usual(front: np.ndarray, areas: np.ndarray, black: float) -> float:
    """Median by area of the lit fronts, the upper one of two; 0 if there is none."""
    shining = np.flatnonzero(front > black)
    if not len(shining):
        return 0.0
    order = shining[np.argsort(front[shining])]
    sums = np.cumsum(areas[order])
    return float(front[order[min(np.searchsorted(sums, sums[-1] / 2.0, side="right"), len(order) - 1)]])
