# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds and peak memory of the stages of a command."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

from ...patchnet_addon.runtime.heap import peak_bytes, resident_bytes


@dataclass(frozen=True)
class Stage:
    """Stage of a command: wall seconds, resident memory when it began, and the most of it until it ended.

    Bytes are None where the system does not say (only Linux does).
    """

    seconds: float
    before_bytes: int | None
    peak_bytes: int | None


class StageClock:
    """Context managers `stage(name)`, and what they measured."""

    def __init__(self) -> None:
        self.stages: dict[str, Stage] = {}
        self._peak: int | None = None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block; one that ends with an error leaves nothing."""
        self._notice_peak()
        _forget_peak()
        before, start = resident_bytes(), time.perf_counter()
        yield
        self.stages[name] = Stage(time.perf_counter() - start, before, peak_bytes())
        self._notice_peak()

    def _notice_peak(self) -> None:
        peak = peak_bytes()
        if peak is not None:
            self._peak = max(peak, self._peak or 0)

    def as_json(self) -> dict[str, Any]:
        """Plain values: stages by name; peak_bytes: the most resident memory of the process so far."""
        self._notice_peak()
        return {"stages": {name: asdict(stage) for name, stage in self.stages.items()}, "peak_bytes": self._peak}


def _forget_peak() -> None:
    """Let the kernel count the peak from now on (proc(5), clear_refs); where it does not, peaks are those so far."""
    try:
        with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
            file.write("5")
    except OSError:
        pass
