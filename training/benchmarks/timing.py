# SPDX-License-Identifier: GPL-3.0-or-later
"""Timing of functions in turns, on one core or on all."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from statistics import median
from typing import Any


def comparison(
    name: str, ours: float, peer: float | None, details: Mapping[str, Any], unit: str, *, higher_is_better: bool = True
) -> dict[str, Any]:
    """Comparison of PatchNet (`ours`) with a peer, None if it could not run, in `unit`, as flat JSON values.

    ratio: above 1 if PatchNet is better. details: other measurements.
    """
    ratio = None if not peer else ours / peer if higher_is_better else peer / max(ours, 1e-9)
    return {"name": name, "ours": ours, "peer": peer, "ratio": ratio, "unit": unit, **details}


def timed(
    functions: Mapping[str, Callable[[], Any]],
    repeats: int,
    threads: int = 1,
    prepare: Callable[[], Any] = lambda: None,
) -> tuple[dict[str, float], dict[str, Any]]:
    """Median seconds of `repeats` runs of each function, in turns, and the conditions, for the JSON.

    A single thread is bound to a core and measured in processor seconds, which other programs' load affects least;
    several threads are measured in wall seconds. Run all functions once before, so that compilation is not timed.
    `prepare` runs before each run, untimed.
    """
    clock = time.perf_counter if threads > 1 else time.process_time
    seconds: dict[str, list[float]] = {who: [] for who in functions}
    # A core for this thread and its children, where the system can (not macOS, Windows).
    cores = os.sched_getaffinity(0) if threads == 1 and hasattr(os, "sched_setaffinity") else None
    if cores is not None:
        os.sched_setaffinity(0, {max(cores)})
    try:
        for _ in range(repeats):
            for who, function in functions.items():
                prepare()
                start = clock()
                function()
                seconds[who].append(clock() - start)
    finally:
        if cores is not None:
            os.sched_setaffinity(0, cores)
    runs = {name: [round(value, 4) for value in values] for name, values in seconds.items()}
    name_of_clock = "wall" if threads > 1 else "processor"
    details = {"threads": threads, "clock": name_of_clock, "repeats": repeats, "runs": runs}
    return {name: median(values) for name, values in seconds.items()}, details
