# SPDX-License-Identifier: GPL-3.0-or-later
"""Comparing two functions on one core."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any


@dataclass(frozen=True)
class Comparison:
    """Seconds of ours and of a peer. ratio: peer / ours, above 1 where ours is faster. details: what was measured."""

    name: str
    ours: float
    peer: float
    ratio: float
    details: dict[str, Any]
    unit: str = "s"

    def as_json(self) -> dict[str, Any]:
        """Flat JSON values."""
        values = asdict(self)
        return values | values.pop("details")


@contextmanager
def one_core() -> Iterator[int]:
    """Bind this thread, and those that it starts, to one core; yields how many cores are used.

    Systems without affinity (macOS, Windows) keep all cores, and the number says so.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield os.cpu_count() or 1
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield 1
    finally:
        os.sched_setaffinity(0, before)


def compare(name: str, ours: Callable[[], Any], peer: Callable[[], Any], repeats: int) -> Comparison:
    """Median of `repeats` runs of each, taking turns on one core, in processor seconds, which other programs' load on
    the machine changes least. Both functions must have run before, so that nothing is compiled within the time.
    """
    seconds: dict[str, list[float]] = {"ours": [], "peer": []}
    with one_core() as cores:
        for _ in range(max(repeats, 1)):
            seconds["ours"].append(_processor_seconds(ours))
            seconds["peer"].append(_processor_seconds(peer))
    middle = {who: median(values) for who, values in seconds.items()}
    details: dict[str, Any] = {"cores": cores, "repeats": len(seconds["ours"])}
    details |= {f"{who}_runs": [round(value, 4) for value in values] for who, values in seconds.items()}
    return Comparison(name, middle["ours"], middle["peer"], middle["peer"] / max(middle["ours"], 1e-9), details)


def _processor_seconds(function: Callable[[], Any]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start
