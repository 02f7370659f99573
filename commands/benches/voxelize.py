# SPDX-License-Identifier: GPL-3.0-or-later
"""Time clipping, averaging and building the octree against Open3D's voxel grid, on the same triangles in memory."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .arguments import SHELLS, add_depth, add_repeats, add_scene, add_threads, read_triangles

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "octree against Open3D's voxel grid"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench voxelize`."""
    add_scene(parser)
    add_depth(parser)
    add_threads(parser, "threads of ours; Open3D has one")
    add_repeats(parser, 3)


def measure(args: argparse.Namespace) -> Comparison:
    """Seconds of both; raises PatchNetError without Open3D."""
    from ...training.benchmarks.voxelize import benchmark_voxelize, import_open3d

    import_open3d()  # before a long scene is read
    result = benchmark_voxelize(read_triangles(args.scene), args.depth, args.repeats, threads=args.threads)
    return replace(result, details={"scene": args.scene.name if args.scene else SHELLS, **result.details})


def text(values: dict[str, Any]) -> str:
    """Return the figures as one sentence."""
    return (
        f"{values['scene']} at depth {values['depth']}: octree of {values['ours_voxels']:,} voxels in "
        f"{values['ours']:.2f} s, {values['peer_name']} {values['peer_voxels']:,} voxels in {values['peer']:.2f} s, "
        f"ratio {values['ratio']:.2f} ({values['clock']} seconds, threads: {values['threads']})"
    )
