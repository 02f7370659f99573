# SPDX-License-Identifier: GPL-3.0-or-later
"""Run `patchnet octree` in a process of its own: seconds of each stage, and peak memory against the prediction."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime.errors import SceneError
from .arguments import add_depth, add_scene

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "the whole job from scene file to octree file: time and memory"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench scene`."""
    add_scene(parser)
    add_depth(parser)
    parser.add_argument("--light", choices=("cycles", "two-lights"), default="two-lights", help="light (two-lights)")


def measure(args: argparse.Namespace) -> Comparison:
    """Time and memory of the job; raises PatchNetError if it fails."""
    from ...training.benchmarks.whole_scene import benchmark_scene

    if not args.scene.is_file():
        raise SceneError(f"Scene file {args.scene} does not exist: check its path")
    result = benchmark_scene(args.scene, args.depth, args.light)
    return replace(result, details={"scene": args.scene.name, **result.details})


def text(values: dict[str, Any]) -> str:
    """Markdown table of stages, and the sums."""
    from ...training.benchmarks.tables import markdown_table

    rows = [
        [name, f"{seconds:.2f} s", f"{values['stage_peak_bytes'][name] / 2**30:.2f} GiB"]
        for name, seconds in values["stage_s"].items()
    ]
    rows.append(["rest", f"{values['other_s']:.2f} s", ""])
    rows.append(["all", f"{values['wall_s']:.2f} s", f"{values['ours'] / 2**30:.2f} GiB"])
    return (
        f"{values['scene']} at depth {values['depth']}, {values['light']}: {values['triangles']:,} triangles, "
        f"{values['leaves']:,} voxels, {values['nodes']:,} nodes\n\n"
        f"{markdown_table(['stage', 'time', 'peak of the whole process'], rows)}\n\n"
        f"Predicted before building: {values['peer'] / 2**30:.2f} GiB, ratio {values['ratio']:.2f}."
    )
