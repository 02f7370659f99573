# SPDX-License-Identifier: GPL-3.0-or-later
"""Time whole frames stage by stage: rays, network, priority, picture; beside them four rays in each pixel."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from ..shared.views import add_views, view_cameras
from .arguments import add_octree, add_repeats, given_octree

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "a frame, from camera to priority and picture, against four rays in each pixel"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench frame`."""
    add_octree(parser, 1_000_000)
    add_views(parser)
    add_number(parser, "--threads", bounds.THREADS, help="threads (one for each core)")
    add_repeats(parser, 5)


def measure(args: argparse.Namespace) -> Comparison:
    """Seconds of each view by stage; raises PatchNetError for a file that is no octree."""
    from ...patchnet_addon.codes.encode import encode_octree
    from ...patchnet_addon.network.weights import load_weights
    from ...patchnet_addon.runtime.progress import drain
    from ...patchnet_addon.runtime.threads import usable_cores
    from ...training.benchmarks.frames import benchmark_frames
    from ...training.benchmarks.tracing import views_of

    octree, name = given_octree(args)
    coded = drain(encode_octree(octree, load_weights()))
    cameras = view_cameras(args) if args.view else views_of(octree, tuple(args.size))
    threads = args.threads or usable_cores()
    results = [benchmark_frames(coded, camera, args.repeats, threads=threads) for camera in cameras]
    details = {"octree": name, "depth": octree.depth, "frames": [result.as_json() for result in results]}
    return replace(results[0], details=details | results[0].details)


def text(values: dict[str, Any]) -> str:
    """Markdown table with a row for each view."""
    from ...training.benchmarks.frames import STAGES
    from ...training.benchmarks.tables import markdown_table

    width, height = values["size"]
    rows = [
        [row["view"], *(f"{row['stage_s'][stage]:.3f}" for stage in STAGES), f"{row['ours']:.3f}", f"{row['peer']:.3f}"]
        for row in values["frames"]
    ]
    return (
        f"{values['octree']}, depth {values['depth']}, {width} x {height}, threads: {values['threads']}; seconds\n\n"
        + markdown_table(["view", *STAGES, "frame", values["peer_name"]], rows)
    )
