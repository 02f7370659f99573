# SPDX-License-Identifier: GPL-3.0-or-later
"""Time of a whole job: what its stages are expected to take, how far it is, and what is left, as it goes on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

from .compiling import is_compiling
from .progress import Progress, Result, Steps

_MOST = 0.995  # of a job that still reports
_LEAST_LEFT = 0.03  # of a stage that takes longer than expected
_MIN_SHARE = 0.02  # of a step, before which its own pace says nothing
_MIN_S = 2.0  # of a step, likewise
_MAIN_STEP = 0.25  # of a stage's expected time, from which on a step is taken for all of it


class JobTime:
    """Share of a job that is done, and seconds left, by expected seconds of its stages and the pace of each step.

    Seconds left are said once the pace of the step that takes most of them says within a factor of two the same: what
    is expected of a scene that is unlike those before may be far off.

    What is left does not rise when a stage goes from one step to the next: the plan of a stage whose main step was
    faster than expected is not taken up again.

    Stages come in the order of `expect`; those of `again` are entered several times, such as the views of cameras. Each
    second counts once, whatever labels and fractions the steps of a stage have, and the share never falls.
    """

    def __init__(self, again: frozenset[str] = frozenset(), clock: Callable[[], float] = time.perf_counter) -> None:
        self._again, self._clock = again, clock
        self._expected: dict[str, float] = {}
        self._spent: dict[str, float] = {}
        self._stage = self._label = ""
        self._begun = self._seen = self._label_begun = clock()
        self._label_first = self._whole = 0.0
        self._sure = False
        self._own = self._most = math.inf  # seconds left of the stage: by the last report, and when its step began
        self.compiled: set[str] = set()  # stages in which kernels were compiled, whose seconds tell nothing

    def expect(self, seconds: Mapping[str, float]) -> None:
        """Take the expected seconds of all stages, by name and in their order; before that nothing is known."""
        self._expected = dict(seconds)

    def see(self, stage: str, progress: Progress) -> Progress:
        """Add to a report of a stage's steps how far the whole job is, once that is known."""
        now = self._clock()
        self._spent[stage] = self._spent.get(stage, 0.0) + (now - self._seen)
        self._seen = now
        if progress.label != self._label or stage != self._stage or progress.fraction < self._label_first:
            self._most = self._own if stage == self._stage and stage not in self._again else math.inf
            self._stage, self._label = stage, progress.label
            self._label_begun, self._label_first = now, progress.fraction
        if progress.note or is_compiling():
            self.compiled.add(stage)
        if not self._expected:
            return progress
        left = self._left(stage, progress, now)
        spent = now - self._begun
        self._whole = max(self._whole, min(spent / max(spent + left, 1e-9), _MOST))
        return replace(progress, whole=self._whole, left_s=left if self._sure else None)

    def _left(self, stage: str, progress: Progress, now: float) -> float:
        stages = list(self._expected)
        at = stages.index(stage) if stage in stages else -1
        left = own = 0.0
        for index, (name, seconds) in enumerate(self._expected.items()):
            rest = max(seconds - self._spent.get(name, 0.0), 0.0)
            if name == stage:
                rest = max(min(rest, self._most - (now - self._label_begun)), _LEAST_LEFT * seconds)
                own = self._own = self._left_of_step(progress, seconds, rest, now)
            elif index > at or name in self._again:
                left += rest
        by_pace = self._by_pace(progress, now)
        self._sure |= by_pace is not None and 0.5 * own <= by_pace <= 2.0 * own and own >= left
        return own + left

    def _left_of_step(self, progress: Progress, seconds: float, rest: float, now: float) -> float:
        """Seconds left of the present stage: as expected, and by the step's own pace the more, the further it is.

        seconds: expected of the stage. rest: of these, what is left. The pace of a short step says nothing of others.
        """
        by_pace = self._by_pace(progress, now)
        if by_pace is None:
            return rest
        if self._stage in self._again:  # there are more such steps
            return max(rest, by_pace)
        trust = progress.fraction * min((now - self._label_begun) / max(_MAIN_STEP * seconds, 1e-9), 1.0)
        return (1.0 - trust) * rest + trust * by_pace

    def _by_pace(self, progress: Progress, now: float) -> float | None:
        share, took = progress.fraction - self._label_first, now - self._label_begun
        return None if share < _MIN_SHARE or took < _MIN_S else took / share * (1.0 - progress.fraction)


def with_time(steps: Steps[Result], job_time: JobTime, stage: Callable[[], str]) -> Steps[Result]:
    """Pass on the steps of a job with how far all of it is; stage: the name of the present one."""
    try:
        while True:
            report = next(steps)
            yield job_time.see(stage(), report)
    except StopIteration as stop:
        return stop.value
    finally:
        steps.close()


def duration_text(seconds: float) -> str:
    """Duration in words: "40 s", "12 min", "2.5 h"."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 100.0 * 60.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
