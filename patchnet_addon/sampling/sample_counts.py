# SPDX-License-Identifier: GPL-3.0-or-later
"""Allocation of samples: a mean number of samples per active pixel, spread over them by priority (methods 7.25b).

A pixel gets 1, 4, 16, 64, 256 or 1024 samples, a square of 1 to 32 a side. A step from one count to the next is an
upgrade; the budget pays for the upgrades with the largest expected drop of squared error per sample. Refined pixels of
a share get samples in the same way, at least 16 each.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..runtime.bounds import REFINED_SAMPLES, SPP

SIDES = (1, 2, 4, 8, 16, 32)  # samples per pixel side
COUNTS = np.array(SIDES, np.int32) ** 2
LEAST_REFINED, MOST_REFINED = int(REFINED_SAMPLES.low), 256  # samples of refined pixels; 1,024 on request
LITTLE = np.finfo(np.float64).tiny  # below every priority from a score
_LARGEST = 1e100  # of priorities, so that their sum is finite
_ROUNDED = 1.0 + 1e-12  # tolerates rounding of a mean computed as total / count


class _Upgrades:
    """Upgrades from one count of samples to the next, starting at one sample per pixel.

    counts: samples before the first upgrade and after each. cost: samples of each. Worth of one of these samples is
    base + slope * priority, in units of the mean priority. Both fall from upgrade to upgrade, so that a pixel takes
    them in order.
    """

    def __init__(self, counts: np.ndarray, error: list[float], by_priority: list[float]) -> None:
        """Upgrades from the squared error of each count relative to the first, and the part of it explained by
        priority.

        The rest is equal in all pixels. Errors are relative to the last count, the reference.
        """
        left, told = np.array(error), np.array(by_priority)
        self.counts, self._error, self._told = counts, error, by_priority
        self.cost = np.diff(counts).astype(np.int64)
        self.base = -np.diff(left * (1.0 - told)) / self.cost
        self.slope = -np.diff(left * told) / self.cost

    def between(self, least: int, most: int) -> _Upgrades:
        """Upgrades of pixels from `least` to `most` samples."""
        part = slice(*np.searchsorted(self.counts, [least, most + 1]))
        return _Upgrades(self.counts[part], self._error[part], self._told[part])


# Measured on octrees. Four samples are no better than the prediction, so a predicted pixel gets 16 or none.
_OF_PREVIEW = _Upgrades(COUNTS, [1.0, 0.33, 0.055, 0.004, 0.0005, 0.0], [0.75, 0.5, 0.25, 0.125, 0.0625, 0.0])
_OF_PREDICTED = _Upgrades(np.delete(COUNTS, 1), [1.0, 0.2, 0.015, 0.002, 0.0], [0.75, 0.5, 0.25, 0.125, 0.0])


def sample_counts(priorities: np.ndarray, mean: float, *, predicted: bool = False) -> np.ndarray:
    """(A,) int32: samples of A pixels with falling `priorities` (A,), for at most `mean` samples per pixel on average.

    predicted: pixels of one sample show the prediction.

    Samples fall with priority; pixels of priority 0 have one. The rest of the budget is too small for a further
    upgrade. Raises SettingError for a mean outside 1 to 1024.
    """
    SPP.check(mean)
    return _bought(priorities, mean, _OF_PREDICTED if predicted else _OF_PREVIEW)


def refined_counts(priorities: np.ndarray, mean: float, *, predicted: bool = False) -> np.ndarray:
    """(N,) int32: samples of N refined pixels with falling `priorities` (N,), for at most `mean` each on average.

    As `sample_counts`, but at least 16 each, and at most 256 unless the mean is higher. Raises SettingError for a mean
    outside 16 to 1024.
    """
    REFINED_SAMPLES.check(mean)
    most = MOST_REFINED if mean <= MOST_REFINED else int(COUNTS[-1])
    return _bought(priorities, mean, (_OF_PREDICTED if predicted else _OF_PREVIEW).between(LEAST_REFINED, most))


def _bought(priorities: np.ndarray, mean: float, upgrades: _Upgrades) -> np.ndarray:
    """(A,) int32: samples of pixels after the `upgrades` that `mean` samples per pixel pay for."""
    least = int(upgrades.counts[0])
    counts = np.full(len(priorities), least, np.int32)
    urgent = np.minimum(priorities[: np.count_nonzero(priorities > 0)].astype(np.float64), _LARGEST)
    if len(urgent) and len(upgrades.cost):
        spare = int(mean * len(priorities) * _ROUNDED) - least * len(priorities)
        for level, length in enumerate(_upgraded(urgent / urgent.mean(), spare, upgrades), start=1):
            counts[:length] = upgrades.counts[level]
    return counts


def pixels_by_side(samples: np.ndarray, order: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield samples per pixel side, and the pixels of an `order` (A,) that have as many in `samples` (P,), most first.

    Pixels of one sample are skipped.
    """
    falling = -samples[order]
    for side in SIDES[:0:-1]:
        first, last = np.searchsorted(falling, -(side**2), "left"), np.searchsorted(falling, -(side**2), "right")
        if first < last:
            yield side, order[first:last]


def _upgraded(relative: np.ndarray, spare: int, upgrades: _Upgrades) -> np.ndarray:
    """(U,) int64: number of first pixels that take each upgrade, by falling worth within `spare` samples.

    relative: (E,) falling priorities over their mean. The optimum takes all upgrades worth more than a Lagrange
    multiplier, the smallest within the budget.
    """
    rising = -relative  # for searchsorted

    def above(bits: int) -> np.ndarray:
        multiplier = np.int64(bits).view(np.float64)
        lowest = (multiplier - upgrades.base) / upgrades.slope
        return np.searchsorted(rising, -lowest, "right")

    # Positive doubles sort like their bits, so bisection over the bits is exact.
    greatest = upgrades.base[0] + 2.0 * upgrades.slope[0] * relative[0]
    low, high = 0, int(greatest.view(np.int64))  # everything, and nothing
    while low < high:
        middle = (low + high) // 2
        if above(middle) @ upgrades.cost <= spare:
            high = middle
        else:
            low = middle + 1
    taken = above(high)
    return _rest_spent(taken, relative, spare - int(taken @ upgrades.cost), upgrades)


def _rest_spent(taken: np.ndarray, relative: np.ndarray, spare: int, upgrades: _Upgrades) -> np.ndarray:
    """Spend the rest of the budget on affordable upgrades, by falling worth."""
    taken = taken.copy()
    while True:
        most = np.concatenate([[len(relative)], taken[:-1]])  # a pixel takes its upgrades in order
        possible = np.flatnonzero((taken < most) & (spare >= upgrades.cost))
        if not len(possible):
            return taken
        worth = upgrades.base[possible] + upgrades.slope[possible] * relative[taken[possible]]
        level = possible[np.argmax(worth)]
        alike = np.searchsorted(-relative, -relative[taken[level]], "right")  # pixels of one priority at once
        count = min(int(min(alike, most[level])) - int(taken[level]), spare // int(upgrades.cost[level]))
        taken[level] += count
        spare -= count * int(upgrades.cost[level])
