# SPDX-License-Identifier: GPL-3.0-or-later
"""Remaining time of a step, by what it has done so far."""

from __future__ import annotations

import time
from collections.abc import Callable

from .job_time import duration_text
from .progress import Progress

_MIN_SHARE = 0.02  # of the step, before which no estimate is made
_MIN_S = 2.0


class Remaining:
    """Remaining time: what reports of a whole job say of it, else by the progress of steps, one after the other.

    A step that begins in its middle, such as a bake that is resumed, is measured from there.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._label = ""
        self._first = 0.0  # share that was done when the step began
        self._last = 0.0
        self._begun = self._reported = clock()
        self._is_told = False  # whether the reports are of a whole job
        self._told: float | None = None

    def see(self, progress: Progress) -> None:
        """Take a report; waiting ones say nothing new."""
        self._is_told, self._told = progress.whole is not None or progress.left_s is not None, progress.left_s
        if progress.label != self._label or progress.fraction < self._last:
            self._label = progress.label
            self._first = self._last = progress.fraction
            self._begun = self._reported = self._clock()
        elif progress.fraction > self._last:
            self._last = progress.fraction
            self._reported = self._clock()

    def seconds(self) -> float | None:
        """Seconds until the job or the step ends, as far as they can be known by now."""
        if self._is_told:
            return self._told
        share, spent = self._last - self._first, self._reported - self._begun
        if share < _MIN_SHARE or spent < _MIN_S:
            return None
        since = self._clock() - self._reported
        return max(spent / share * (1.0 - self._last) - since, 0.0)

    def text(self) -> str:
        """Remaining time in words: "about 40 s left", or ""."""
        return left_text(self.seconds())


def left_text(seconds: float | None) -> str:
    """Seconds left in words: "about 40 s left"; "" where they are not known, or next to none."""
    return "" if seconds is None or seconds < 1.0 else f"about {duration_text(seconds)} left"
