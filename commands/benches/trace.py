# SPDX-License-Identifier: GPL-3.0-or-later
"""Time the tracer against Embree on the same triangles, and against our own rays one at a time."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SceneError, SettingError
from ..shared.arguments import add_number
from ..shared.views import add_views, view_cameras
from .arguments import add_depth, add_repeats, add_scene, read_triangles

if TYPE_CHECKING:
    from ...patchnet_addon.octree.octree import Octree
    from ...training.benchmarks.timing import Comparison

HELP = "rays per second against Embree's, thread for thread"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench trace`."""
    parser.add_argument(
        "file", type=Path, nargs="?", help="octree file of the scene (its triangles are voxelized at --depth)"
    )
    add_scene(parser, required=False)
    add_depth(parser)
    add_views(parser)
    add_number(parser, "--threads", bounds.THREADS, default=1, help="threads of ours; Embree has one (1)")
    parser.add_argument(
        "--plot", type=Path, help="also draw ours over threads, picture size and depth, to a .png, .svg or .pdf file"
    )
    add_repeats(parser, 5)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates in all views; raises PatchNetError without Embree where a scene is given."""
    from ...training.benchmarks.embree_peer import EmbreeScene, import_embree
    from ...training.benchmarks.figures import check_figure
    from ...training.benchmarks.tracing import benchmark_tracing, views_of
    from ...training.benchmarks.tracing_growth import draw_growth, measure_growth

    if args.scene is None and args.file is None:
        raise SettingError("There is nothing to trace: give a --scene, an octree file, or both")
    if args.plot is not None:
        check_figure(args.plot, [path for path in (args.scene, args.file) if path is not None])
    embree, triangles = None, None
    if args.scene is not None:
        import_embree()  # before a long scene is read
        if not args.scene.is_file():
            raise SceneError(f"Scene file {args.scene} does not exist: check its path")
        triangles = read_triangles(args.scene)
    octree = _octree(args, triangles)
    if triangles is not None:
        embree = EmbreeScene(triangles)
        del triangles
    cameras = view_cameras(args) if args.view else views_of(octree, tuple(args.size))
    result = benchmark_tracing(octree, cameras, embree, args.repeats, threads=args.threads)
    name = args.scene.name if args.scene is not None else args.file.name
    details = {"scene": name, **result.details}
    if args.plot is not None:
        details["growth"] = measure_growth(octree, cameras, args.repeats, args.threads)
        title = f"{name}, depth {octree.depth}, {cameras[0].width_px} x {cameras[0].height_px}"
        draw_growth(details["growth"], args.plot, title)
    return replace(result, details=details)


def _octree(args: argparse.Namespace, triangles: Any) -> Octree:
    from ...patchnet_addon.octree.file import load_octree
    from ...patchnet_addon.octree.grid import Grid
    from ...training.benchmarks.voxelize import OurVoxels

    if args.file is not None:
        return load_octree(args.file)
    voxels = OurVoxels(triangles)
    voxels.voxelize(Grid.around(voxels.mesh.bounds_world, args.depth))
    assert voxels.octree is not None
    return voxels.octree


def text(values: dict[str, Any]) -> str:
    """Markdown table with a row for each view."""
    from ...training.benchmarks.tables import markdown_table

    peer = values["peer_name"] or "no peer"
    head = [
        "view", "hit", "ours", peer, "ratio", "one by one", "leaves", "with all hits' data", "fine costs",
        "behind costs", "32x32", "32x32 one by one", "ratio", "visits a ray", "boxes cost, at 32x32",
    ]  # fmt: skip
    rows = [_row(row) for row in values["views"]]
    width, height = values["size"]
    lines = [
        f"{values['scene']}, depth {values['depth']}, {width} x {height}, threads: {values['threads']}, "
        f"{values['clock']} seconds; million rays per second\n",
        markdown_table(head, rows),
    ]
    if values["ratio"] is not None:
        lines.append(f"\nGeometric mean over the views: {values['ratio']:.2f} of {peer}")
    return "\n".join(lines)


def _row(row: dict[str, Any]) -> list[str]:
    rates = {name: f"{rate / 1e6:.1f}" for name, rate in row["rays_per_s"].items()}
    return [
        row["name"],
        f"{row['hit_share']:.0%}",
        rates["ours"],
        rates.get("embree", ""),
        "" if row["ratio"] is None else f"{row['ratio']:.2f}",
        rates["single"],
        rates["leaves"],
        rates["picture"],
        f"{row['fine_costs']:.0%}",
        f"{row['behind_costs']:.0%}",
        rates["reference"],
        rates["single_reference"],
        f"{row['reference_over_single']:.1f}",
        f"{row['visits_per_ray']:.2f}",
        "" if row["boxes_cost"] is None else f"{row['boxes_cost']:.0%}, {row['boxes_cost_reference']:.0%}",
    ]
