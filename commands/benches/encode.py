# SPDX-License-Identifier: GPL-3.0-or-later
"""Time the encoder against torch's on the same corners, and on the whole octree: corners per second."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from .arguments import add_octree, add_repeats, add_threads, given_octree, in_other_process

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "the whole encoder against torch's"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench encode`."""
    add_octree(parser, 600_000)
    parser.add_argument("--weights", type=Path, help="weights file (those that are shipped)")
    add_number(parser, "--corners", bounds.CORNERS, default=50_000, help="corners to encode, about (50000)")
    add_threads(parser, "threads of ours and of torch")
    add_repeats(parser, 5)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of both, in a process that has so many threads; raises PatchNetError."""
    if (result := in_other_process(args, "corners", "weights")) is not None:
        return result
    from ...patchnet_addon.network.weights import load_weights
    from ...training.benchmarks.encoding import benchmark_encoding

    octree, name = given_octree(args)
    result = benchmark_encoding(octree, load_weights(args.weights), args.corners, args.repeats, threads=args.threads)
    return replace(result, details={"octree": name, "nodes": octree.node_count, **result.details})


def text(values: dict[str, Any]) -> str:
    """Sentences about corners and rates."""
    peer = "no torch here" if values["peer"] is None else (
        f"{values['peer_name']} {values['peer']:,.0f}, ratio {values['ratio']:.2f}"
    )  # fmt: skip
    return (
        f"{values['octree']}: {values['corners']:,} corners of {values['blocks']:,} blocks, "
        f"{values['occupied_cells']:.0%} of their cells occupied\n"
        f"Corners per second: ours {values['ours']:,.0f}; {peer} "
        f"({values['clock']} seconds, threads: {values['threads']})\n"
        f"Whole octree, corners found and codes stored: {values['octree_corners_per_s']:,.0f} of "
        f"{values['all_corners']:,} corners per second"
    )
