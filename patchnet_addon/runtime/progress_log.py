# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of steps as log events."""

from __future__ import annotations

import time
from collections.abc import Callable

from .eta import Eta
from .log import event
from .progress import Progress

_PAUSE_S = 1.0


class ProgressLog:
    """Progress log: an event for each new step, and at most one a second for its progress.

    title: name of all steps together.
    """

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._title, self._clock = title, clock
        self._label = ""
        self._said = 0.0
        self._eta = Eta(clock)

    def see(self, progress: Progress) -> None:
        """Log a report."""
        self._eta.see(progress)
        now, begins = self._clock(), progress.label != self._label
        if not begins and now - self._said < _PAUSE_S:
            return
        self._label, self._said = progress.label, now
        left = self._eta.seconds()
        event(
            "stage" if begins else "progress",
            f"{self._title}: {progress.label}" if self._title else progress.label,
            stage=progress.step or progress.label,
            fraction=round(progress.fraction, 4),
            frame=progress.frame,
            whole=None if progress.whole is None else round(progress.whole, 4),
            seconds_left=None if left is None else round(left, 1),
        )
