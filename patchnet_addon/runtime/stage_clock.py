# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage timer: wall seconds of the stages of a job by name, and on request their peak memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

from .heap import peak_bytes, resident_bytes


@dataclass(frozen=True)
class Stage:
    """Stage of a command: wall seconds, resident memory when it began, and the most of it until it ended.

    Bytes are None where they were not asked for, or the system does not say (only Linux does).
    """

    seconds: float
    before_bytes: int | None = None
    peak_bytes: int | None = None


class StageClock:
    """Measures stages: `with clock.stage(name)`, in the order of their first use; those of one name add up.

    memory: measure the process's memory, too, which lets the kernel count its peak anew at each stage.
    """

    def __init__(self, *, memory: bool = False) -> None:
        self.stages: dict[str, Stage] = {}
        self.present = ""  # name of the stage that was entered last
        self._memory = memory
        self._peak: int | None = None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block; one that ends with an error leaves nothing."""
        self.present = name
        before = self._begin() if self._memory else None
        start = time.perf_counter()
        yield
        seconds, peak = time.perf_counter() - start, self._notice_peak() if self._memory else None
        if (earlier := self.stages.get(name)) is not None:
            seconds += earlier.seconds
            before, peak = earlier.before_bytes, max(filter(None, (peak, earlier.peak_bytes)), default=None)
        self.stages[name] = Stage(seconds, before, peak)

    @property
    def seconds(self) -> dict[str, float]:
        """Wall seconds by stage."""
        return {name: stage.seconds for name, stage in self.stages.items()}

    def as_json(self) -> dict[str, Any]:
        """Plain values: stages by name; peak_bytes: the most resident memory of the process so far."""
        self._notice_peak()
        return {"stages": {name: asdict(stage) for name, stage in self.stages.items()}, "peak_bytes": self._peak}

    def _begin(self) -> int | None:
        self._notice_peak()
        _forget_peak()
        return resident_bytes()

    def _notice_peak(self) -> int | None:
        peak = peak_bytes()
        if peak is not None:
            self._peak = max(peak, self._peak or 0)
        return peak


def _forget_peak() -> None:
    """Let the kernel count the peak from now on (proc(5), clear_refs); where it does not, peaks are those so far."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
            file.write("5")
    except OSError:
        pass
