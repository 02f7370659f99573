# SPDX-License-Identifier: GPL-3.0-or-later
"""Timing of functions in turns, on one core or on all, in a process with so many threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.threads import usable_cores

# BLAS and others read these when they are loaded.
_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"
)  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """Comparison of ours with a peer, in `unit`.

    ratio: peer / ours, above 1 where ours is better. peer and ratio are None where the peer could not run.
    details: what else was measured, plain JSON values.
    """

    name: str
    ours: float
    peer: float | None
    ratio: float | None
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


@contextmanager
def every_core() -> Iterator[int]:
    """Change nothing; yields how many cores may be used."""
    yield usable_cores()


def compare(
    name: str,
    ours: Callable[[], Any],
    peer: Callable[[], Any],
    repeats: int,
    *,
    all_cores: bool = False,
    max_seconds: float = float("inf"),
    prepare: Callable[[], Any] | None = None,
) -> Comparison:
    """Median of `repeats` runs of each, taking turns; fewer, but at least one, once they took `max_seconds`.

    On one core in processor seconds, which other programs' load on the machine changes least; on all cores in wall
    seconds. Both functions must have run before, so that nothing is compiled within the time. `prepare` runs before
    each run, outside the time.
    """
    seconds = take_turns(
        {"ours": ours, "peer": peer}, repeats, all_cores=all_cores, max_seconds=max_seconds, prepare=prepare
    )
    middle = {who: median(values) for who, values in seconds.items()}
    details: dict[str, Any] = how_measured(all_cores) | {"repeats": len(seconds["ours"])}
    details |= {f"{who}_runs": [round(value, 4) for value in values] for who, values in seconds.items()}
    return Comparison(name, middle["ours"], middle["peer"], middle["peer"] / max(middle["ours"], 1e-9), details)


def take_turns(
    functions: dict[str, Callable[[], Any]],
    repeats: int,
    *,
    all_cores: bool = False,
    max_seconds: float = float("inf"),
    prepare: Callable[[], Any] | None = None,
) -> dict[str, list[float]]:
    """Seconds of each run of each function, as `compare` measures them."""
    clock = time.perf_counter if all_cores else time.process_time
    seconds: dict[str, list[float]] = {who: [] for who in functions}
    begin = time.perf_counter()
    with every_core() if all_cores else one_core():
        for turn in range(max(repeats, 1)):
            if turn and time.perf_counter() - begin > max_seconds:
                break
            for who, function in functions.items():
                if prepare is not None:
                    prepare()
                start = clock()
                function()
                seconds[who].append(clock() - start)
    return seconds


def how_measured(all_cores: bool) -> dict[str, Any]:
    """Cores and clock of `take_turns`, for the JSON."""
    with every_core() if all_cores else one_core() as cores:
        return {"cores": cores, "clock": "wall" if all_cores else "processor"}


def environment_of_threads(threads: int) -> dict[str, str]:
    """This process's environment, with so many threads for every library."""
    return os.environ | dict.fromkeys(_VARIABLES, str(threads))


def has_threads(threads: int) -> bool:
    """Return whether this process was started in such an environment."""
    return all(os.environ.get(name) == str(threads) for name in _VARIABLES)


def run_with_threads(words: Sequence[str], threads: int) -> Comparison:
    """Run `patchnet bench WORDS --json` in a process whose libraries have so many threads; raises PatchNetError."""
    package = __name__.partition(".training")[0]
    command = [sys.executable, "-m", package, "bench", *words, "--json"]
    ended = subprocess.run(command, stdout=subprocess.PIPE, text=True, env=environment_of_threads(threads), check=False)
    if ended.returncode:
        raise PatchNetError(f"`patchnet bench {words[0]}` failed on {threads} threads: read its message above")
    values = json.loads(ended.stdout.splitlines()[-1])
    return Comparison(**{name: values.pop(name) for name in ("name", "ours", "peer", "ratio", "unit")}, details=values)
