# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiling of kernels at their first use, in seconds of each step of a job: first voxelize, first bake, first preview.

Each step runs twice in a process of its own, with an empty folder of kernels before the first step, and so does a job
that does all of it.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..shared.job_arguments import require_blender

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "compiling of kernels at first use: seconds of each step"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench first-use`."""
    parser.add_argument("--demo", action="store_true", help="run the whole demo too, twice")


def measure(args: argparse.Namespace) -> Comparison:
    """Seconds of the steps on the demo courtyard; raises PatchNetError."""
    require_blender()
    from ...operators.demo_scene import save_demo_scene
    from ...training.benchmarks.first_use import benchmark_first_use
    from ..shared.quiet import quiet_stdout

    with tempfile.TemporaryDirectory(prefix="patchnet-") as name:
        folder = Path(name)
        scene = folder / "courtyard.blend"
        with quiet_stdout():
            save_demo_scene(scene)
        return benchmark_first_use(scene, folder, demo=args.demo)


def text(values: dict[str, Any]) -> str:
    """Markdown table of the steps."""
    from ...training.benchmarks.tables import markdown_table

    steps = (
        values["steps"]
        | {"first job, from scene to pictures": values["whole"]}
        | ({} if values["demo"] is None else {"first demo": values["demo"]})
    )
    rows = [
        [
            name,
            f"{step['first_s']:.1f}",
            f"{step['second_s']:.1f}",
            f"{step['compiling_s']:.1f}",
            f"{step['compiling_processor_s']:.1f}",
        ]
        for name, step in steps.items()
    ]
    head = ["step", "first run, s", "second run, s", "compiling, s", "compiling, processor s"]
    return (
        f"{markdown_table(head, rows)}\n\nCompiling takes {values['ours']:.1f} s in the first three steps together, "
        f"{values['processor_s']:.1f} processor seconds."
    )
