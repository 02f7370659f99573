# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage timer: wall seconds of a job by stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StageClock:
    """Timer of stages, `with clock.stage(name)`, in the order of their first use; repeated stages add up.

    A stage within another one, such as the views after a round of a bake, does not count for the outer one.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.present = ""  # outermost stage, or the last one: a job is as far as that
        self._within: list[float] = []  # seconds of the stages within each open one

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block; a block that raises does not count."""
        if not self._within:
            self.present = name
        self._within.append(0.0)
        start = time.perf_counter()
        try:
            yield
            own = time.perf_counter() - start - self._within[-1]
            self.seconds[name] = self.seconds.get(name, 0.0) + own
        finally:
            self._within.pop()
            if self._within:
                self._within[-1] += time.perf_counter() - start
