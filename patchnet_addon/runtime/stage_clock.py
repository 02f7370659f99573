# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage timer: wall seconds of a job by stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StageClock:
    """Timer of stages, `with clock.stage(name)`, in the order of their first use; repeated stages add up."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.present = ""  # last entered stage

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block; a block that raises does not count."""
        self.present = name
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
