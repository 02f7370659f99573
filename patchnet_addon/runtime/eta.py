# SPDX-License-Identifier: GPL-3.0-or-later
"""Remaining time: of a step by its pace, of a job by its expected stages, of an animation by its frames."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from statistics import median_low

from .compiling import compiling_seconds
from .progress import Progress

_MOST = 0.995  # largest share of an unfinished job
_LEAST_LEFT = 0.03  # of a stage or frame that takes longer than expected
_MIN_SHARE, _MIN_S = 0.02, 2.0  # of a step, before which its pace says nothing
_MAIN_STEP = 0.25  # of a stage's expected time, from which on a step is taken for all of it
_STEADY = 0.2  # of a step, after which its pace alone counts
_LAST_FRAMES = 3  # that the next one is taken to be like

Clock = Callable[[], float]


class _Pace:
    """Pace of the present step, from the progress of its first report on: a resumed bake starts in the middle."""

    def __init__(self, label: str = "", fraction: float = 0.0, now: float = 0.0) -> None:
        self._label, self._first, self.fraction = label, fraction, fraction
        self._begun = self._reported = now

    def sees(self, label: str, fraction: float, now: float) -> _Pace:
        """Update with a report; returns the pace of its step."""
        if label != self._label or fraction < self.fraction:
            return _Pace(label, fraction, now)
        if fraction > self.fraction:
            self.fraction, self._reported = fraction, now
        return self

    def left(self, now: float) -> float | None:
        """Seconds until the step ends; None while unknown."""
        share, spent = self.fraction - self._first, self._reported - self._begun
        if share < _MIN_SHARE or spent < _MIN_S:
            return None
        return max(spent / share * (1.0 - self.fraction) - (now - self._reported), 0.0)

    def spent(self, now: float) -> float:
        """Seconds since the step began."""
        return now - self._begun


class Eta:
    """Remaining seconds shown to users: those of the whole job if reports have them, else of the present step."""

    def __init__(self, clock: Clock = time.perf_counter) -> None:
        self._clock, self._pace = clock, _Pace()
        self._is_told = False
        self._told: float | None = None

    def see(self, progress: Progress) -> None:
        """Update with a report."""
        self._is_told, self._told = progress.whole is not None or progress.left_s is not None, progress.left_s
        self._pace = self._pace.sees(progress.label, progress.fraction, self._clock())

    def seconds(self) -> float | None:
        """Seconds until the job or the step ends; None while unknown."""
        return self._told if self._is_told else self._pace.left(self._clock())

    def text(self) -> str:
        """Remaining time in words: "about 40 s left", or ""."""
        return left_text(self.seconds())


class JobEta:
    """Finished share of a job and remaining seconds, by expected seconds of its stages and the pace of each step.

    Remaining seconds are known from the start if they are measured on this machine, until a stage takes longer;
    otherwise once the pace of a long step agrees with them. They never increase between the steps of a stage. Stages
    come in the order of `expect`; those of `again` are entered several times, such as the views of cameras. The share
    never decreases.
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
        self.compiled: set[str] = set()  # stages that compiled kernels: their seconds do not predict others
        self._compiling_s = compiling_seconds()

    def expect(self, seconds: Mapping[str, float], *, measured: bool = False) -> None:
        """Set the expected seconds of all stages, by name in their order; nothing is known before.

        measured: the seconds come from earlier jobs on this machine.
        """
        self._expected, self._measured = dict(seconds), measured

    def see(self, stage: str, progress: Progress) -> Progress:
        """Add the finished share of the whole job to a report, once it is known."""
        now = self._clock()
        self._spent[stage] = self._spent.get(stage, 0.0) + (now - self._seen)
        self._seen = now
        pace = self._pace.sees(f"{stage}: {progress.label}", progress.fraction, now)
        if pace is not self._pace:
            self._most = self._own if stage == self._stage and stage not in self._again else math.inf
            self._stage, self._pace = stage, pace
        before, self._compiling_s = self._compiling_s, compiling_seconds()
        if progress.note or self._compiling_s > before:
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
        """Remaining seconds of the present stage: a mix of its expected seconds and its step's pace.

        The pace weighs more the longer the step takes; that of a short step says little about others. seconds: expected
        seconds of the stage. rest: remaining part of them.
        """
        rest = max(min(rest, self._most - self._pace.spent(now)), _LEAST_LEFT * seconds)
        by_pace = self._pace.left(now)
        if by_pace is None:
            self._own = rest
        elif self._stage in self._again:  # more steps follow
            self._own = max(rest, by_pace)
        else:
            length = self._pace.spent(now) + by_pace
            trust = min(length / max(_MAIN_STEP * seconds, 1e-9), 1.0) * min(self._pace.fraction / _STEADY, 1.0)
            self._own = (1.0 - trust) * rest + trust * by_pace
        return self._own


class FramesEta:
    """Finished share of all frames of an animation and remaining seconds.

    A frame is expected to take as long as the last rendered ones without compilation, the first one as long as its own
    reports say. The share never decreases.
    """

    def __init__(self, frames: int, clock: Clock = time.monotonic) -> None:
        """Start with the number of frames to render, without those that exist."""
        self._left, self._done, self._clock = frames, 0, clock
        self._seconds: list[float] = []
        self._whole = 0.0
        self.begin()

    def begin(self) -> None:
        """Start a frame."""
        self._begun = self._seen = self._clock()
        self._compiled, self._noted_s = compiling_seconds(), 0.0

    def one_more(self) -> None:
        """Expect one frame more: an existing frame is outdated."""
        self._left += 1

    @property
    def text(self) -> str:
        """Present frame and number of frames in words."""
        return f"Frame {self._done + 1} of {self._done + max(self._left, 1)}"

    def end(self) -> None:
        """Finish a rendered frame."""
        compiled = compiling_seconds() - self._compiled + self._noted_s
        self._seconds.append(max(self._clock() - self._begun - compiled, 0.0))
        self._done += 1
        self._left = max(self._left - 1, 0)

    def see(self, progress: Progress) -> Progress:
        """Add the finished share of all frames to a report of a frame's steps."""
        before, self._seen = self._seen, self._clock()
        if progress.note:  # the engine process compiles
            self._noted_s += self._seen - before
        spent = self._seen - self._begun
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
        """Add the finished share of all frames to a report between two frames."""
        return self._told(progress, 0.0, self._left)

    def _told(self, progress: Progress, share: float, left: int) -> Progress:
        self._whole = max(self._whole, min((self._done + share) / max(self._done + left, 1), 1.0))
        return replace(progress, whole=self._whole)


def _share(spent: float, left: float) -> float:
    """Finished share by seconds, below 1 while steps still report."""
    return min(spent / max(spent + left, 1e-9), _MOST)


def left_text(seconds: float | None) -> str:
    """Remaining seconds in words: "about 40 s left"; "" where unknown or close to 0."""
    return "" if seconds is None or seconds < 1.0 else f"about {duration_text(seconds)} left"


def range_text(low: float, high: float) -> str:
    """Duration between two in words: "2 to 4 min", "50 s to 2 min"; "about 40 s" where both read alike."""
    first, last = duration_text(low), duration_text(high)
    if first == last:
        return f"about {last}"
    same = first.rpartition(" ")[2] == last.rpartition(" ")[2]
    return f"{first.rpartition(' ')[0] if same else first} to {last}"


def duration_text(seconds: float) -> str:
    """Duration in words: "40 s", "12 min", "2.5 h"."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 100.0 * 60.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
