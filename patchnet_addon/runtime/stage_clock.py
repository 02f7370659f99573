# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage timer: wall seconds of the stages of a job by name."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StageClock:
    """Measures stages: `with clock.stage(name)`, in the order of their first use; those of one name add up."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.present = ""  # name of the stage that was entered last

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the block; one that ends with an error leaves nothing."""
        self.present = name
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
