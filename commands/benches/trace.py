# SPDX-License-Identifier: GPL-3.0-or-later
"""Time the tracer against Embree on the same triangles."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime.errors import SceneError
from ..shared.views import add_views, view_cameras
from .arguments import SHELLS, add_depth, add_repeats, add_scene, add_threads, read_triangles

if TYPE_CHECKING:
    from ...patchnet_addon.octree.octree import Octree
    from ...training.benchmarks.timing import Comparison

HELP = "rays per second against Embree's, thread for thread"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench trace`."""
    parser.add_argument(
        "file", type=Path, nargs="?", help="octree file of the scene (its triangles are voxelized at --depth)"
    )
    add_scene(parser)
    add_depth(parser)
    add_views(parser)
    add_threads(parser, "threads of ours; Embree has one")
    add_repeats(parser, 5)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates in all views; raises PatchNetError without Embree, but for an octree file alone, which has no triangles."""
    from ...training.benchmarks.tracing import EmbreeScene, benchmark_tracing, import_embree, views_of

    embree, triangles = None, None
    if args.scene is not None or args.file is None:
        import_embree()  # before a long scene is read
        if args.scene is not None and not args.scene.is_file():
            raise SceneError(f"Scene file {args.scene} does not exist: check its path")
        triangles = read_triangles(args.scene)
    octree = _octree(args, triangles)
    if triangles is not None:
        embree = EmbreeScene(triangles)
        del triangles
    cameras = view_cameras(args) if args.view else views_of(octree, tuple(args.size))
    result = benchmark_tracing(octree, cameras, embree, args.repeats, threads=args.threads)
    given = args.scene or args.file
    return replace(result, details={"scene": given.name if given else SHELLS, **result.details})


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
        "view", "hit", "ours", peer, "ratio", "leaves", "with all hits' data", "fine costs", "behind costs", "32x32",
        "visits a ray", "boxes cost, at 32x32",
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
        rates["leaves"],
        rates["picture"],
        f"{row['fine_costs']:.0%}",
        f"{row['behind_costs']:.0%}",
        rates["reference"],
        f"{row['visits_per_ray']:.2f}",
        "" if row["boxes_cost"] is None else f"{row['boxes_cost']:.0%}, {row['boxes_cost_reference']:.0%}",
    ]
