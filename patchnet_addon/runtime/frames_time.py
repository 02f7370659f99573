# SPDX-License-Identifier: GPL-3.0-or-later
"""Time of an animation: how far all of its frames are, and seconds left, by the frames that were made."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median_low

from .compiling import compiling_seconds
from .progress import Progress

_LAST = 3  # frames that the next one is taken to be like
_LEAST_LEFT = 0.03  # of a frame that takes longer than those before
_MOST = 0.99  # of a frame that still reports


class FramesTime:
    """Share of all frames that is done, and seconds left.

    A frame takes as long as the last ones that were made, without what those compiled; the first one as long as it says
    itself, if it does. The share never falls.
    """

    def __init__(self, frames: int, clock: Callable[[], float] = time.monotonic) -> None:
        """Take the number of frames that are likely to be made: those that are there take no time."""
        self._left, self._done, self._clock = frames, 0, clock
        self._seconds: list[float] = []
        self._begun, self._compiled = clock(), compiling_seconds()
        self._whole = 0.0

    def begin(self) -> None:
        """Begin a frame."""
        self._begun, self._compiled = self._clock(), compiling_seconds()

    def one_more(self) -> None:
        """Expect one frame more: one that is there, but is not what it would be now."""
        self._left += 1

    @property
    def text(self) -> str:
        """Frame that is made now, of all of them, in words."""
        return f"Frame {self._done + 1} of {self._done + max(self._left, 1)}"

    def end(self) -> None:
        """End a frame that was made."""
        compiled = compiling_seconds() - self._compiled
        self._seconds.append(max(self._clock() - self._begun - compiled, 0.0))
        self._done += 1
        self._left = max(self._left - 1, 0)

    def see(self, progress: Progress) -> Progress:
        """Add to a report of a frame's steps how far all frames are; its own seconds left are those of the frame."""
        spent = self._clock() - self._begun
        usual = median_low(self._seconds[-_LAST:]) if self._seconds else None
        left = progress.left_s
        if usual is not None:
            by_others = max(usual - spent, _LEAST_LEFT * usual)
            left = by_others if left is None else (left + by_others) / 2.0
        share = 0.0 if left is None else min(spent / max(spent + left, 1e-9), _MOST)
        of_all = (self._done + share) / max(self._done + max(self._left, 1), 1)
        self._whole = max(self._whole, min(of_all, 1.0))
        if left is not None:
            left += max(self._left - 1, 0) * (spent + left if usual is None else usual)
        return replace(progress, whole=self._whole, left_s=left)

    def skip(self, progress: Progress) -> Progress:
        """Add to a report between two frames how far all frames are."""
        whole = max(self._whole, self._done / max(self._done + self._left, 1))
        self._whole = min(whole, 1.0)
        return replace(progress, whole=self._whole)
