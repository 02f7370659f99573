# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmark of first use: what compiling kernels for the first time adds to each step of a job.

Each step is a command in a process of its own, run with the kernels that the steps before it have left, and again with
its own. The difference is what compiling took, loading of kernels included.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...patchnet_addon.runtime.errors import PatchNetError
from .child import run_child
from .timing import Comparison

_DEPTH = "6"


@dataclass(frozen=True)
class Step:
    """Seconds of a step with kernels to compile and without: wall seconds, and processor seconds of all threads."""

    first_s: float
    second_s: float
    first_processor_s: float
    second_processor_s: float

    @property
    def compiling_s(self) -> float:
        """Wall seconds that the first run took longer."""
        return self.first_s - self.second_s

    @property
    def compiling_processor_s(self) -> float:
        """Processor seconds that the first run took longer."""
        return self.first_processor_s - self.second_processor_s


def benchmark_first_use(scene: Path, folder: Path, *, demo: bool) -> Comparison:
    """Compiling in wall seconds of three steps on a scene file, one after the other, of a job, and of the demo.

    folder: empty, for results and for kernels. demo: run the demo too, which takes minutes. Raises PatchNetError for a
    step that fails.
    """
    small = [str(scene), "--depth", _DEPTH]
    commands = {
        "first voxelize": ["octree", *small, "--light", "two-lights", "--out", str(folder / "plain.safetensors")],
        "first bake": [
            "octree",
            *small,
            "--light",
            "cycles",
            "--samples",
            "1",
            "--out",
            str(folder / "lit.safetensors"),
        ],
        "first preview": ["run", *small, "--light", "two-lights", "--size", "96", "64", "--out", str(folder / "run")],
    }
    steps = {name: _step(words, folder / "kernels") for name, words in commands.items()}
    whole = _step(commands["first preview"], folder / "run-kernels")
    details: dict[str, Any] = {
        "scene": scene.name,
        "steps": {name: _as_json(step) for name, step in steps.items()},
        "whole": _as_json(whole),
        "processor_s": sum(step.compiling_processor_s for step in steps.values()),
        "demo": None,
    }
    if demo:
        details["demo"] = _as_json(_step(["demo", "--out", str(folder / "demo")], folder / "demo-kernels"))
    return Comparison("first-use", sum(step.compiling_s for step in steps.values()), None, None, details)


def _step(words: list[str], kernels: Path) -> Step:
    environment = os.environ | {"PATCHNET_CACHE": str(kernels), "PATCHNET_KEEP": "0"}
    first, second = (_seconds(words, environment) for _ in range(2))
    return Step(first[0], second[0], first[1], second[1])


def _seconds(words: list[str], environment: Mapping[str, str]) -> tuple[float, float]:
    """Wall and processor seconds of a command."""
    child = run_child([sys.executable, "-m", __name__.partition(".training")[0], *words], environment)
    if child.code:
        raise PatchNetError(f"`patchnet {words[0]}` ended with code {child.code}, see above")
    return child.seconds, child.processor_seconds


def _as_json(step: Step) -> dict[str, float]:
    return {
        "first_s": step.first_s,
        "second_s": step.second_s,
        "compiling_s": step.compiling_s,
        "compiling_processor_s": step.compiling_processor_s,
    }
