# SPDX-License-Identifier: GPL-3.0-or-later
"""Time the octree at several depths, per fragment, leaf and triangle, against Open3D's voxel grid where it fits."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from .arguments import add_cores, add_repeats, add_scene, read_triangles

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "cost per fragment, leaf and triangle as depth grows"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench depths`."""
    add_scene(parser)
    add_number(
        parser,
        "--depths",
        bounds.DEPTH,
        nargs=2,
        default=(7, 10),
        metavar=("FIRST", "LAST"),
        help="octree depths (7 10)",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help=".png, .svg or .pdf to draw the cost into")
    add_number(parser, "--peer-depth", bounds.DEPTH, default=14, help="deepest depth for Open3D (where memory ends)")
    add_number(
        parser, "--most-seconds", bounds.SECONDS, default=60.0, help="no further run of a depth after this time (60)"
    )
    add_cores(parser)
    add_repeats(parser, 3)


def measure(args: argparse.Namespace) -> Comparison:
    """Cost of each depth; the line of a depth goes to stderr when it is known; raises PatchNetError."""
    from ...training.benchmarks.depths import check_depths, compare_depths, measure_depths
    from ...training.benchmarks.depths_figure import draw_depths
    from ...training.benchmarks.figures import check_figure
    from ...training.benchmarks.open3d_peer import import_open3d

    check_depths(*args.depths)
    if args.plot is not None:
        check_figure(args.plot, [args.scene])
    peer_name = f"Open3D {import_open3d().__version__}"
    all_cores = args.cores == "all"
    costs = []
    for cost in measure_depths(
        read_triangles(args.scene),
        range(args.depths[0], args.depths[1] + 1),
        args.repeats,
        all_cores=all_cores,
        max_seconds=args.most_seconds,
        peer_depth=args.peer_depth,
    ):
        print(f"depth {cost.depth}: {cost.fragments:,} fragments in {cost.seconds:.2f} s", file=sys.stderr)
        costs.append(cost)
    result = compare_depths(costs, peer_name, all_cores)
    if args.plot is not None:
        cores = f"{result.details['cores']} core" + ("s" if result.details["cores"] > 1 else "")
        title = f"{args.scene.stem}: {costs[0].triangles:,} triangles, {cores}, {result.details['clock']} seconds"
        draw_depths(costs, args.plot, title, peer_name)
    plot = args.plot.name if args.plot is not None else None
    return replace(result, details={"scene": args.scene.name, "plot": plot, **result.details})


def text(values: dict[str, Any]) -> str:
    """Markdown table, and the prices that explain it."""
    from ...training.benchmarks.tables import markdown_table

    head = ["depth", "fragments", "leaves", "time", "ns per fragment", "ns per leaf", "ns per triangle", "runs"]
    rows = [
        [row["depth"], f"{row['fragments']:,}", f"{row['leaves']:,}", f"{row['seconds']:.2f} s"]
        + [f"{row['ns_per_' + name]:,.0f}" for name in ("fragment", "leaf", "triangle")]
        + [row["runs"], _peer(row)]
        for row in values["depths"]
    ]
    return "\n".join(
        [
            f"{values['scene']}: {values['triangles']:,} triangles, {values['clock']} time, cores: {values['cores']}",
            "",
            markdown_table([*head, values["peer_name"]], rows),
            "",
            f"{values['fit_ns_per_triangle']:.0f} ns a triangle and {values['fit_ns_per_fragment']:.0f} ns a fragment "
            f"explain the times within {values['fit_largest_deviation']:.0%}.",
        ]
    )


def _peer(row: dict[str, Any]) -> str:
    return row["peer_skipped"] or f"{row['peer_seconds']:.2f} s"
