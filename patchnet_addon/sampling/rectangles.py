# SPDX-License-Identifier: GPL-3.0-or-later
"""Maximum-sum rectangle of a table, among those that avoid what is taken.

Kadane's algorithm along the columns, for all pairs of rows at once (Bentley, Programming Pearls, CACM 27(9), 1984):
O(R^2 C) additions for R rows and C columns.
"""

from __future__ import annotations

import numpy as np

Box = tuple[int, int, int, int]  # first row, last row + 1, first column, last column + 1


def best_rectangle(values: np.ndarray, taken: np.ndarray) -> tuple[float, Box | None]:
    """Greatest sum of `values` (R, C) float64 over a rectangle without a cell of `taken` (R, C) bool, and its box.

    (-inf, None) if all cells are taken.
    """
    rows, columns = values.shape
    first, last = np.triu_indices(rows)
    sums, blocked = _strips(values, first, last), _strips(taken.astype(np.float64), first, last) > 0
    running = np.full(len(first), -np.inf)  # best sum that ends in the present column, of each pair of rows
    start = np.zeros(len(first), np.int64)
    best, box = -np.inf, None
    for column in range(columns):
        anew = ~(running > 0.0)
        start[anew] = column
        running = np.where(anew, 0.0, running) + sums[:, column]
        running[blocked[:, column]] = -np.inf
        pair = int(np.argmax(running))
        if running[pair] > best:
            best = float(running[pair])
            box = int(first[pair]), int(last[pair]) + 1, int(start[pair]), column + 1
    return best, box


def _strips(values: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(n, C): sums of each column over rows first[i] to last[i]."""
    summed = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return summed[last + 1] - summed[first]
