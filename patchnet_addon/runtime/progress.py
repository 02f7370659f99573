# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of long steps, which are generators that yield `Progress` and return their result.

The command line and `execute()` drain them, a modal operator advances them for a time slice per timer tick, and closing
a generator runs its `finally` blocks: one implementation for all three.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

Result = TypeVar("Result")
_COUNTED = 1000


@dataclass(frozen=True)
class Progress:
    """Progress of the step `label`: `done` of `total` units are finished.

    waiting: the engine process or a Blender job computes; pull again later. whole: finished share of all steps, 0 to 1,
    where a caller counts them. left_s: seconds until all are finished. frame: frame of the animation; `step` is then
    the label without it. note: reason for an unusual delay, or "". partial: unfinished result that a caller may show.
    """

    done: float
    total: float
    label: str
    waiting: bool = False
    whole: float | None = None
    frame: int | None = None
    step: str = ""
    note: str = ""
    left_s: float | None = None
    partial: Any = None

    @property
    def fraction(self) -> float:
        """Finished share, 0 to 1."""
        return min(max(self.done / self.total, 0.0), 1.0) if self.total > 0 else 1.0

    @property
    def count_text(self) -> str:
        """Finished units of a step with few of them, such as calls of a bake: " 3 of 8"; else ""."""
        counts = 1 < self.total <= _COUNTED and self.total == int(self.total)
        return f" {int(self.done)} of {int(self.total)}" if counts else ""


Steps = Generator[Progress, None, Result]


def drain(steps: Steps[Result], on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Run `steps` to the end and return their result; `on_progress` receives every report."""
    try:
        while True:
            report = next(steps)
            if on_progress is not None:
                on_progress(report)
    except StopIteration as stop:
        return stop.value
    finally:
        steps.close()


def changed(steps: Steps[Result], change: Callable[[Progress], Progress]) -> Steps[Result]:
    """Yield all reports of `steps` after `change`."""
    try:
        while True:
            yield change(next(steps))
    except StopIteration as stop:
        return stop.value
    finally:
        steps.close()


def labelled(steps: Steps[Result], text: str) -> Steps[Result]:
    """Relabel steps; `{}` in `text` stands for their own label."""
    return changed(steps, lambda report: replace(report, label=text.format(report.label)))
