# SPDX-License-Identifier: GPL-3.0-or-later
"""Allocation of samples: a mean number of samples per active pixel, spread over them by priority (methods 7.25b).

A pixel gets 1, 4, 16, 64, 256 or 1024 samples: one, or a square of 2 to 32 a side. Going from one count to the next is
an upgrade, and the budget buys those upgrades that are expected to lower the squared error most per sample.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..runtime.bounds import SPP

SIDES = (1, 2, 4, 8, 16, 32)  # samples per pixel side
COUNTS = np.array(SIDES, np.int32) ** 2
DECAY = 1.5  # a: the squared error of n samples is that of one over n^a
_LARGEST = 1e100  # of priorities, so that their powers are finite
_ROUNDED = 1.0 + 1e-12  # gives back what rounding took from a mean that is a total over a count
_COST = np.diff(COUNTS).astype(np.int64)  # samples of each upgrade
_WORTH = -np.diff(COUNTS.astype(np.float64) ** -DECAY) / _COST  # of each of these samples, for a priority of 1


def sample_counts(priorities: np.ndarray, mean: float, power: float = 1.0) -> np.ndarray:
    """(A,) int32: samples of A pixels whose `priorities` (A,) fall, for at most `mean` samples per pixel on average.

    power: the squared error of a pixel is expected to grow as its priority to this power. No pixel has fewer samples
    than one after it; pixels whose priority is not above 0 have one. What is left of the budget pays for no further
    upgrade. Raises SettingError for a mean outside 1 to 1024.
    """
    SPP.check(mean)
    urgent = priorities[: np.count_nonzero(priorities > 0)].astype(np.float64)
    counts = np.ones(len(priorities), np.int32)
    if len(urgent):
        spare = int(mean * len(priorities) * _ROUNDED) - len(priorities)
        lengths = _upgraded(np.minimum(urgent, _LARGEST) ** power, spare)
        for level, length in enumerate(lengths, start=1):
            counts[:length] = COUNTS[level]
    return counts


def runs_of_equal_counts(counts: np.ndarray) -> Iterator[tuple[int, slice]]:
    """Samples per pixel side, and the pixels that have so many, for `counts` (A,) that fall; not those of one sample.

    The most samples come first.
    """
    for side in SIDES[:0:-1]:
        first, last = np.searchsorted(-counts, -(side**2), "left"), np.searchsorted(-counts, -(side**2), "right")
        if first < last:
            yield side, slice(int(first), int(last))


def _upgraded(errors: np.ndarray, spare: int) -> np.ndarray:
    """(5,) int64: how many of the first pixels take each upgrade, those of most worth within `spare` samples.

    errors: (E,) expected squared errors of single samples, which fall. The worth of an upgrade's sample is that times a
    number that falls from upgrade to upgrade, so the best choice for a budget is all upgrades of more worth than a
    Lagrange multiplier: the smallest one that the budget pays for.
    """
    falling = -errors  # searchsorted wants what rises

    def above(bits: int) -> np.ndarray:
        multiplier = np.int64(bits).view(np.float64)
        return np.array([np.searchsorted(falling, -(multiplier / worth), "right") for worth in _WORTH])

    # Bits of positive doubles are in the order of their values, so halving them finds the very number.
    low, high = 0, int(np.float64(-2.0 * falling[0]).view(np.int64))  # the first buys everything, the last nothing
    while low < high:
        middle = (low + high) // 2
        if above(middle) @ _COST <= spare:
            high = middle
        else:
            low = middle + 1
    taken = above(high)
    return _rest_spent(taken, falling, spare - int(taken @ _COST))


def _rest_spent(taken: np.ndarray, falling: np.ndarray, spare: int) -> np.ndarray:
    """Spend what is left on upgrades that it still pays for, those of most worth first, until none is left."""
    taken = taken.copy()
    while True:
        most = np.concatenate([[len(falling)], taken[:-1]])  # a pixel takes an upgrade after the one before
        open_ = np.flatnonzero((taken < most) & (spare >= _COST))
        if not len(open_):
            return taken
        level = open_[np.argmin(falling[taken[open_]] * _WORTH[open_])]
        alike = np.searchsorted(falling, falling[taken[level]], "right")  # pixels of one priority at once
        count = min(int(min(alike, most[level])) - int(taken[level]), spare // int(_COST[level]))
        taken[level] += count
        spare -= count * int(_COST[level])
