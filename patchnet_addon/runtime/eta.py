# SPDX-License-Identifier: GPL-3.0-or-later
"""Time left: of a step by its pace, of a job by what its stages should take, of an animation by its frames."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from statistics import median_low

from .compiling import compiling_seconds, is_compiling
from .progress import Progress

_MOST = 0.995  # of a job that still reports
_LEAST_LEFT = 0.03  # of a stage or a frame that takes longer than expected
_MIN_SHARE, _MIN_S = 0.02, 2.0  # of a step, before which its pace says nothing
_MAIN_STEP = 0.25  # of a stage's expected time, from which on a step is taken for all of it
_STEADY = 0.2  # of a step, after which its pace alone counts
_LAST_FRAMES = 3  # that the next one is taken to be like

Clock = Callable[[], float]


class _Pace:
    """Pace of the present step, measured from where it began: a resumed bake begins in its middle."""

    def __init__(self, label: str = "", fraction: float = 0.0, now: float = 0.0) -> None:
        self._label, self._first, self.fraction = label, fraction, fraction
        self._begun = self._reported = now

    def sees(self, label: str, fraction: float, now: float) -> _Pace:
        """Take a report; the result is the pace of the step that it is of."""
        if label != self._label or fraction < self.fraction:
            return _Pace(label, fraction, now)
        if fraction > self.fraction:
            self.fraction, self._reported = fraction, now
        return self

    def left(self, now: float) -> float | None:
        """Seconds until the step ends; None while nothing is known."""
        share, spent = self.fraction - self._first, self._reported - self._begun
        if share < _MIN_SHARE or spent < _MIN_S:
            return None
        return max(spent / share * (1.0 - self.fraction) - (now - self._reported), 0.0)

    def spent(self, now: float) -> float:
        """Seconds since the step began."""
        return now - self._begun


class Eta:
    """Seconds left as users are told: what reports of a whole job say, else those of the present step, by its pace."""

    def __init__(self, clock: Clock = time.perf_counter) -> None:
        self._clock, self._pace = clock, _Pace()
        self._is_told = False
        self._told: float | None = None

    def see(self, progress: Progress) -> None:
        """Take a report."""
        self._is_told, self._told = progress.whole is not None or progress.left_s is not None, progress.left_s
        self._pace = self._pace.sees(progress.label, progress.fraction, self._clock())

    def seconds(self) -> float | None:
        """Seconds until the job or the step ends, as far as they can be known by now."""
        return self._told if self._is_told else self._pace.left(self._clock())

    def text(self) -> str:
        """Time left in words: "about 40 s left", or ""."""
        return left_text(self.seconds())


class JobEta:
    """Share of a job that is done, and seconds left, by expected seconds of its stages and the pace of each step.

    Seconds left are said once the pace of a step that takes a good part of them agrees with them; what this machine
    took for other jobs is said from the start, for as long as a stage takes no longer. They do not rise when a stage
    goes to its next step. Stages come in the order of `expect`; those of `again` are entered several times, such as the
    views of cameras. The share never falls.
    """

    def __init__(self, again: frozenset[str] = frozenset(), clock: Clock = time.perf_counter) -> None:
        self._again, self._clock, self._pace = again, clock, _Pace()
        self._expected: dict[str, float] = {}
        self._spent: dict[str, float] = {}
        self._stage = ""
        self._begun = self._seen = clock()
        self._whole = 0.0
        self._sure = self._measured = False
        self._own = self._most = math.inf  # seconds left of the stage: by the last report, and when its step began
        self.compiled: set[str] = set()  # stages in which kernels were compiled, whose seconds tell nothing

    def expect(self, seconds: Mapping[str, float], *, measured: bool = False) -> None:
        """Take the expected seconds of all stages, by name and in their order; before that nothing is known.

        measured: jobs on this machine took as long for as much.
        """
        self._expected, self._measured = dict(seconds), measured

    def see(self, stage: str, progress: Progress) -> Progress:
        """Add to a report of a stage's steps how far the whole job is, once that is known."""
        now = self._clock()
        self._spent[stage] = self._spent.get(stage, 0.0) + (now - self._seen)
        self._seen = now
        pace = self._pace.sees(f"{stage}: {progress.label}", progress.fraction, now)
        if pace is not self._pace:
            self._most = self._own if stage == self._stage and stage not in self._again else math.inf
            self._stage, self._pace = stage, pace
        if progress.note or is_compiling():
            self.compiled.add(stage)
        if not self._expected:
            return progress
        left = self._left(stage, now)
        self._whole = max(self._whole, _share(now - self._begun, left))
        planned = self._measured and self._spent[stage] <= self._expected.get(stage, 0.0)
        return replace(progress, whole=self._whole, left_s=left if self._sure or planned else None)

    def _left(self, stage: str, now: float) -> float:
        stages = list(self._expected)
        at = stages.index(stage) if stage in stages else -1
        rest = {name: max(seconds - self._spent.get(name, 0.0), 0.0) for name, seconds in self._expected.items()}
        others = [name for index, name in enumerate(stages) if index > at or (name in self._again and index != at)]
        later = sum(rest[name] for name in others)
        own = self._left_of_stage(self._expected[stage], rest[stage], now) if at >= 0 else 0.0
        by_pace = self._pace.left(now)
        self._sure |= by_pace is not None and 0.5 * own <= by_pace <= 2.0 * own and 2.0 * own >= later
        return own + later

    def _left_of_stage(self, seconds: float, rest: float, now: float) -> float:
        """Seconds left of the present stage: as expected, and by its step's pace the more, the longer the step is.

        seconds: expected of the stage. rest: of these, what is left. The pace of a short step says nothing of others.
        """
        rest = max(min(rest, self._most - self._pace.spent(now)), _LEAST_LEFT * seconds)
        by_pace = self._pace.left(now)
        if by_pace is None:
            self._own = rest
        elif self._stage in self._again:  # there are more such steps
            self._own = max(rest, by_pace)
        else:
            length = self._pace.spent(now) + by_pace
            trust = min(length / max(_MAIN_STEP * seconds, 1e-9), 1.0) * min(self._pace.fraction / _STEADY, 1.0)
            self._own = (1.0 - trust) * rest + trust * by_pace
        return self._own


class FramesEta:
    """Share of all frames of an animation that is done, and seconds left.

    A frame takes as long as the last ones that were made, without what those compiled; the first one as long as it says
    itself, if it does. The share never falls.
    """

    def __init__(self, frames: int, clock: Clock = time.monotonic) -> None:
        """Take the number of frames that are likely to be made: those that are there take no time."""
        self._left, self._done, self._clock = frames, 0, clock
        self._seconds: list[float] = []
        self._whole = 0.0
        self.begin()

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
        usual = median_low(self._seconds[-_LAST_FRAMES:]) if self._seconds else None
        left = progress.left_s
        if usual is not None:
            by_others = max(usual - spent, _LEAST_LEFT * usual)
            left = by_others if left is None else (left + by_others) / 2.0
        share = 0.0 if left is None else _share(spent, left)
        if left is not None:
            left += max(self._left - 1, 0) * (spent + left if usual is None else usual)
        return replace(self._told(progress, share, max(self._left, 1)), left_s=left)

    def skip(self, progress: Progress) -> Progress:
        """Add to a report between two frames how far all frames are."""
        return self._told(progress, 0.0, self._left)

    def _told(self, progress: Progress, share: float, left: int) -> Progress:
        self._whole = max(self._whole, min((self._done + share) / max(self._done + left, 1), 1.0))
        return replace(progress, whole=self._whole)


def _share(spent: float, left: float) -> float:
    """Share of some seconds that is spent: never all of what still reports."""
    return min(spent / max(spent + left, 1e-9), _MOST)


def left_text(seconds: float | None) -> str:
    """Seconds left in words: "about 40 s left"; "" where they are not known, or next to none."""
    return "" if seconds is None or seconds < 1.0 else f"about {duration_text(seconds)} left"


def duration_text(seconds: float) -> str:
    """Duration in words: "40 s", "12 min", "2.5 h"."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 100.0 * 60.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
