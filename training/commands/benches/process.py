# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine process: its start, its calls, and the surface of a scene that is handed to it once."""

from __future__ import annotations

import argparse
import gc
import os
import time
from pathlib import Path
from statistics import median
from typing import Any

import bpy

from ....commands.shared.quiet import quiet_stdout
from ....commands.shared.scene_argument import open_or_build
from ....operators.scene.read import read_scene
from ....patchnet_addon.process.computed import (
    answer,
    end_engine_process,
    engine_pid,
    leave_engine_process,
    use_engine_process,
)
from ....patchnet_addon.runtime.memory import resident_bytes
from ...benchmarks.timing import comparison

_CALLS = 200
_ASKED = "triangle_count"


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Times and memory; raises PatchNetError."""
    use_engine_process()
    try:
        starts = [_seconds_of_start() for _ in range(args.repeats)]
        calls = [_timed(len, ()) for _ in range(_CALLS)]
        with quiet_stdout():
            open_or_build(args.scene)
            begun = time.perf_counter()
            source = read_scene(bpy.context.evaluated_depsgraph_get(), "VISIBLE")
            reading = time.perf_counter() - begun
        gc.collect()
        before = resident_bytes() or 0
        first, again = _timed(getattr, source, _ASKED), median(_timed(getattr, source, _ASKED) for _ in range(9))
        details = {
            "scene": Path(args.scene).name,
            "triangles": source.triangle_count,
            "start_ms": 1000.0 * median(starts),
            "call_ms": 1000.0 * median(calls),
            "handed_over_s": first,
            "again_ms": 1000.0 * again,
            "more_mb_in_blender": ((resident_bytes() or 0) - before) >> 20,
            "in_engine_mb": _segments_mb(),
            "cores": os.cpu_count(),
        }
    finally:
        leave_engine_process()
    return comparison("process", 1.0 / first, 1.0 / reading, details, "surfaces per second, against reading it")


def _seconds_of_start() -> float:
    end_engine_process()
    return _timed(len, ())


def _timed(function: Any, *arguments: Any) -> float:
    begun = time.perf_counter()
    answer(function, *arguments)
    return time.perf_counter() - begun


def _segments_mb() -> int:
    """Memory of all segments that the engine maps."""
    lines = Path(f"/proc/{engine_pid()}/maps").read_text(encoding="ascii", errors="replace").splitlines()
    spans = [line.split()[0].split("-") for line in lines if "memfd:patchnet" in line]
    return sum(int(end, 16) - int(begin, 16) for begin, end in spans) >> 20
