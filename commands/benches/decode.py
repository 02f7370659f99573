# SPDX-License-Identifier: GPL-3.0-or-later
"""Time the decoder, interpolation included, against torch's layers alone: pixels per second on so many threads."""

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

HELP = "the whole decoder against torch's layers alone"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench decode`."""
    add_octree(parser, 1_000_000)
    add_number(
        parser, "--pixels", bounds.DECODED_PIXELS, default=150_000, help="pixels with look-ahead, about (150000)"
    )
    add_threads(parser, "threads of every library")
    parser.add_argument("--weights", type=Path, help="weights file (those that are shipped)")
    add_repeats(parser, 9)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of all, in a process that has so many threads; raises PatchNetError."""
    if (result := in_other_process(args, "pixels", "weights")) is not None:
        return result
    from ...patchnet_addon.codes.encode import encode_octree
    from ...patchnet_addon.network.weights import load_weights
    from ...patchnet_addon.runtime.progress import drain
    from ...training.benchmarks.decoding import benchmark_decoding

    octree, name = given_octree(args)
    coded = drain(encode_octree(octree, load_weights(args.weights)))
    result = benchmark_decoding(coded, args.pixels, args.repeats, threads=args.threads)
    return replace(result, details={"octree": name, "nodes": octree.node_count, **result.details})


def text(values: dict[str, Any]) -> str:
    """Sentence about the pixels, and a Markdown table of rates."""
    from ...training.benchmarks.tables import markdown_table

    rates = values["pixels_per_s"]
    names = {
        "decode": "ours, whole decode",
        "torch": f"{values['torch']}: layers alone",
        "trace": "tracing the same pixels",
    }
    rows = [
        [title, f"{rates[name]:,.0f}", f"{values['ours'] / rates[name]:.2f}"]
        for name, title in names.items()
        if name in rates
    ]
    return (
        f"{values['octree']}: {values['pixels']:,} pixels, {values['decoded_pixels']:,} of them with look-ahead; "
        f"network: {values['network']}; threads: {values['threads']}, {values['clock']} seconds\n\n"
        f"{markdown_table(['', 'pixels per second', 'ours to that'], rows)}"
    )
