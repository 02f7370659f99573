# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of long steps, which are generators of `Progress` whose return value is the result.

The command line and `execute()` drain them, a modal operator pulls them a time slice per timer tick,
and closing one runs its `finally` blocks: one implementation for all three.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import TypeVar

Result = TypeVar("Result")
_COUNTED = 1000


@dataclass(frozen=True)
class Progress:
    """Progress of the step called `label`: `done` of `total` units are finished.

    waiting: a thread, or a job of Blender's, is at work for the step, on what the step has put there: ask again later.
    whole: share of all steps that is done, 0 to 1, where a caller counts them. left_s: seconds until all are, then.
    frame: of the animation that the step belongs to; `step` is then the label without it.
    note: why it takes longer than usual, or "".
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

    @property
    def fraction(self) -> float:
        """Share that is done, 0 to 1."""
        return min(max(self.done / self.total, 0.0), 1.0) if self.total > 0 else 1.0

    @property
    def count_text(self) -> str:
        """Finished parts of a step that has a few whole ones, such as pages of a bake: " 3 of 8"; else ""."""
        counts = 1 < self.total <= _COUNTED and self.total == int(self.total)
        return f" {int(self.done)} of {int(self.total)}" if counts else ""


Steps = Generator[Progress, None, Result]


def drain(steps: Steps[Result], on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Run `steps` to its end and return its result; `on_progress` sees every report."""
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
    """Pass on steps, each report as `change` makes it."""
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
