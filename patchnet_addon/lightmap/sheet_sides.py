# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides of sheets: which one voxels show the light of, decided for a whole sheet (methods 7.2f).

The light that falls on both sides is measured at points spread over the sheet by area. It does not decide alone: a
ceiling may rightly face a dim room while the sun shines on its top, and a lampshade has its lamp inside. What cameras
see decides with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# A side with less than this share of the other's light looks black beside it, and no noise of a probe makes it so.
CLEAR = 2.5
_SEEN_BEHIND = 0.9  # of the pixels that a sheet is seen in: it is seen from behind alone
_ENCLOSED = 0.02  # of the other side's light, and of what is usual: nobody is meant to look at that side
DARK = 1e-3  # of the brightest side: nothing to be seen on either
BLACK = 1e-6  # of it: no light at all
MOST_SHEETS = 512
_POINTS, _FEWEST, _MOST = 2048, 4, 32  # of all sheets, of one at least and at most
_STEPS = 0.7548776662466927, 0.5698402909980532  # of points in a triangle: powers of 1 / the plastic number


class SheetPoints(NamedTuple):
    """Points on sheets. triangle: (P,) int64. barycentric: (P, 2) weights of corners 1 and 2. sheet: (P,) int64."""

    triangle: np.ndarray
    barycentric: np.ndarray
    sheet: np.ndarray


def asked_sheets(areas: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Sheets (N,) int64 of S whose light is worth measuring: those that most pixels see from behind, then the largest.

    areas: (S,) of what may be shown from either side, 0 for those that are no open sheets. seen: (S, 2) pixels that see
    the front and the back. At most MOST_SHEETS.
    """
    order = np.lexsort((-areas, -seen[:, 1]))
    order = order[areas[order] > 0.0]
    return order[:MOST_SHEETS]


def points_on_sheets(asked: np.ndarray, sheet: np.ndarray, areas: np.ndarray) -> SheetPoints:
    """Spread points over sheets (N,) by area, the same number on each, without chance.

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


def turned_sheets(light: np.ndarray, areas: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(N,) bool: sheets whose back is shown.

    light: (N, 2) on front and back, means over the sheet. areas: (N,). seen: (N, 2) pixels of cameras that see them.
    The back of a sheet is shown that is seen from behind alone and gets CLEAR times the light there; of one that nobody
    sees, if its front is enclosed: next to no light beside its back's, and beside what other fronts get. Whatever is
    seen from its front shows that.
    """
    front, back = light[:, 0], light[:, 1]
    brightest = float(light.max(initial=0.0))
    lit = back > DARK * brightest
    total = seen.sum(axis=1)
    behind = (total > 0) & (seen[:, 1] >= _SEEN_BEHIND * total)
    usual = _usual(front, areas, BLACK * brightest)
    enclosed = (front < _ENCLOSED * back) & (front <= _ENCLOSED * usual)
    result: np.ndarray = lit & np.where(total > 0, behind & (back > CLEAR * front), enclosed)
    return result


def lit_on_both_sides(light: np.ndarray) -> np.ndarray:
    """(N,) bool: sheets of which neither side is enclosed; light: (N, 2) on front and back."""
    result: np.ndarray = light.min(axis=1) > _ENCLOSED * light.max(axis=1)
    return result


def _usual(front: np.ndarray, areas: np.ndarray, black: float) -> float:
    """Median by area of the fronts that get light, the upper one of two; 0 where none does."""
    shining = np.flatnonzero(front > black)
    if not len(shining):
        return 0.0
    order = shining[np.argsort(front[shining])]
    sums = np.cumsum(areas[order])
    return float(front[order[min(np.searchsorted(sums, sums[-1] / 2.0, side="right"), len(order) - 1)]])
