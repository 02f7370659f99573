# SPDX-License-Identifier: GPL-3.0-or-later
"""Timing of functions in turns, on one core or on all."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any


@dataclass(frozen=True)
class Comparison:
    """Comparison of PatchNet (`ours`) with a peer, in `unit`.

    ratio: above 1 if PatchNet is better. peer and ratio are None if the peer could not run. details: other
    measurements, as plain JSON values.
    """

    name: str
    ours: float
    peer: float | None
    ratio: float | None
    details: dict[str, Any]
    unit: str = "s"

    @classmethod
    def of_rates(cls, name: str, ours: float, peer: float | None, details: dict[str, Any], unit: str) -> Comparison:
        """Comparison of rates: higher is better."""
        return cls(name, ours, peer, ours / peer if peer else None, details, unit)

    def as_json(self) -> dict[str, Any]:
        """Flat JSON values."""
        values = asdict(self)
        return values | values.pop("details")


@contextmanager
def one_core() -> Iterator[None]:
    """Bind this thread and its children to one core, where the system can (not macOS, Windows)."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def take_turns(
    functions: Mapping[str, Callable[[], Any]],
    repeats: int,
    threads: int = 1,
    prepare: Callable[[], Any] = lambda: None,
) -> dict[str, list[float]]:
    """Seconds of `repeats` runs of each function, in turns.

    A single thread is bound to a core and measured in processor seconds, which other programs' load affects least;
    several threads are measured in wall seconds. Run all functions once before, so that compilation is not timed.
    `prepare` runs before each run, untimed.
    """
    clock = time.perf_counter if threads > 1 else time.process_time
    seconds: dict[str, list[float]] = {who: [] for who in functions}
    with nullcontext() if threads > 1 else one_core():
        for _ in range(repeats):
            for who, function in functions.items():
                prepare()
                start = clock()
                function()
                seconds[who].append(clock() - start)
    return seconds


def timed(
    functions: Mapping[str, Callable[[], Any]],
    repeats: int,
    threads: int = 1,
    prepare: Callable[[], Any] = lambda: None,
) -> tuple[dict[str, float], dict[str, Any]]:
    """Median seconds of each function by `take_turns`, and the conditions, for the JSON."""
    seconds = take_turns(functions, repeats, threads, prepare)
    runs = {name: [round(value, 4) for value in values] for name, values in seconds.items()}
    clock = "wall" if threads > 1 else "processor"
    details = {"threads": threads, "clock": clock, "repeats": repeats, "runs": runs}
    return {name: median(values) for name, values in seconds.items()}, details
