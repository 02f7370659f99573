# SPDX-License-Identifier: GPL-3.0-or-later
"""Look-ahead of a camera-fitted octree against the deepest uniform one that is built in the same memory."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime.errors import SceneError, SettingError
from ..shared.views import add_views, view_cameras
from .arguments import add_scene

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "look-ahead of a camera-fitted octree against a uniform one in the same memory"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench fit`."""
    add_scene(parser)
    add_views(parser)


def measure(args: argparse.Namespace) -> Comparison:
    """Leaves, memory and look-ahead of both; raises PatchNetError if one cannot be built."""
    from ...training.benchmarks.fitted import benchmark_fit

    if not args.scene.is_file():
        raise SceneError(f"Scene file {args.scene} does not exist: check its path")
    if not args.view:
        raise SettingError("There is nothing to fit to: give at least one --view")
    memory = 8.0 if args.memory is None else args.memory
    result = benchmark_fit(args.scene, args.view, view_cameras(args), memory)
    return replace(result, details={"scene": args.scene.name, **result.details})


def text(values: dict[str, Any]) -> str:
    """Markdown table with a row for each octree."""
    from ...training.benchmarks.tables import markdown_table

    rows = [
        [
            row["name"],
            f"{row['leaves'] / 1e6:,.1f} M",
            f"{row['octree_bytes'] / 2**30:.2f} GiB",
            "" if row["peak_bytes"] is None else f"{row['peak_bytes'] / 2**30:.2f} GiB",
            "" if row["wall_s"] is None else f"{row['wall_s']:.0f} s",
            "" if row["lookahead_share"] is None else f"{row['lookahead_share']:.1%}",
        ]
        for row in values["octrees"]
    ]
    width, height = values["size"]
    views = "one view" if values["views"] == 1 else f"{values['views']} views"
    return f"{values['scene']}, {views} of {width} x {height}\n\n" + markdown_table(
        ["octree", "leaves", "nodes take", "peak of the whole process", "time", "look-ahead"], rows
    )
