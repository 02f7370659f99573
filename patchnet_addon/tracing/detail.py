# SPDX-License-Identifier: GPL-3.0-or-later
"""Detail of the surface in an octree: where it is scattered, as in furniture, plants and wires."""

from __future__ import annotations

import numpy as np

from ..octree.octree import Octree

_FINER = 2  # levels from the cells to the voxels whose places are measured
_RUGGED = (0.05, 0.5)  # ratio of variances of a sampled slope, and of scattered surface
_CORE, _CORE_SHARE = 0.8, 2.0 / 3.0  # of the detail: within the core along each axis, and along all three
_CORE_EXTENT = 0.4  # of the cube: what is larger is the scene itself


def surface_detail(octree: Octree, level: int) -> np.ndarray:
    """Detail (n, n, n) float64 by x, y, z of cells of a level: 0 on flat surface, low at the creases of a room.

    It is the smallest over the middle variance of the places of surface in the 27 cells around.
    """
    side, finest = 1 << level, min(level + _FINER, octree.depth)
    places = (octree.cells(finest) + 0.5) / (1 << finest - level)
    cells = np.ravel_multi_index(tuple(places.astype(np.int64).T), (side,) * 3)
    there = np.unique(cells)
    variances = _variances(places, cells, side, there)
    detail = np.zeros((side,) * 3)
    ratio = variances[:, 0] / np.maximum(variances[:, 1], 1e-3)
    detail.flat[there] = (np.clip(ratio, *_RUGGED) - _RUGGED[0]) ** 2
    return detail


def _variances(places: np.ndarray, cells: np.ndarray, side: int, there: np.ndarray) -> np.ndarray:
    """Principal variances (m, 3), ascending, of the places (n, 3) in the 27 cells around each cell `there` (m,).

    cells: number (n,) of the cell of each place.
    """
    x, y, z = places.T
    terms = np.ones_like(x), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z
    sums = [_box_sum(np.bincount(cells, term, side**3).reshape((side,) * 3)).flat[there] for term in terms]
    count, *moments = sums
    mean = np.stack(moments[:3]) / count
    square = np.stack(moments[3:])[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3, -1) / count
    return np.linalg.eigvalsh((square - mean[:, None] * mean).transpose(2, 0, 1))


def _box_sum(values: np.ndarray) -> np.ndarray:
    """Sum over the 27 cells around each, (n, n, n)."""
    for axis in range(3):
        ends = [(1, 1) if each == axis else (0, 0) for each in range(3)]
        values = np.lib.stride_tricks.sliding_window_view(np.pad(values, ends), 3, axis).sum(axis=-1)
    return values


def detailed_core(detail: np.ndarray) -> np.ndarray:
    """Cells (n, 3) of a small part of the scene that has most of its `surface_detail`; (0, 3) if there is none."""
    cells, shares = np.argwhere(detail > 0.0), detail[detail > 0.0]
    if not len(cells):
        return cells
    low, high = (_quantiles(cells, shares, share) for share in ((1.0 - _CORE) / 2, (1.0 + _CORE) / 2))
    within = ((cells >= low) & (cells <= high)).all(axis=1)
    found = (high - low).max() < _CORE_EXTENT * len(detail) and shares[within].sum() > _CORE_SHARE * shares.sum()
    return cells[within & found]


def _quantiles(cells: np.ndarray, weight: np.ndarray, share: float) -> np.ndarray:
    """Weighted quantile (3,) of each coordinate of cells (n, 3)."""
    order = np.argsort(cells, axis=0, kind="stable")
    below = np.cumsum(weight[order], axis=0) < share * weight.sum()
    return np.take_along_axis(cells, order, 0)[np.minimum(below.sum(axis=0), len(cells) - 1), range(3)]
