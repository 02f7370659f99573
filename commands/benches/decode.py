# SPDX-License-Identifier: GPL-3.0-or-later
"""Time the decoder, interpolation included, against torch's layers alone: pixels per second on so many threads."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import PatchNetError
from ..shared.arguments import add_number
from .arguments import add_repeats

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "the whole decoder against torch's layers alone"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench decode`."""
    parser.add_argument("file", type=Path, nargs="?", help="octree file (one of --nodes nodes is made)")
    add_number(parser, "--nodes", bounds.NODES, default=3_000_000, help="nodes of the octree that is made (3000000)")
    add_number(
        parser, "--pixels", bounds.DECODED_PIXELS, default=500_000, help="pixels with look-ahead, about (500000)"
    )
    add_number(parser, "--threads", bounds.THREADS, help="threads of every library (one for each core)")
    parser.add_argument("--weights", type=Path, help="weights file (those that are shipped)")
    add_repeats(parser, 9)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of all, in a process that has so many threads; raises PatchNetError."""
    from ...patchnet_addon.codes.encode import encode_octree
    from ...patchnet_addon.network.weights import load_weights
    from ...patchnet_addon.octree.file import load_octree
    from ...patchnet_addon.runtime.progress import drain
    from ...patchnet_addon.runtime.threads import usable_cores
    from ...training.benchmarks.decoding import benchmark_decoding
    from ...training.benchmarks.shells import octree_of_shells
    from ...training.benchmarks.threads import has_threads

    threads = args.threads or usable_cores()
    if not has_threads(threads):
        return _in_a_process_of_threads(args, threads)
    octree = load_octree(args.file) if args.file is not None else octree_of_shells(args.nodes)
    coded = drain(encode_octree(octree, load_weights(args.weights)))
    result = benchmark_decoding(coded, args.pixels, args.repeats, threads=threads)
    name = args.file.name if args.file is not None else "shells"
    return replace(result, details={"octree": name, "nodes": octree.node_count, **result.details})


def _in_a_process_of_threads(args: argparse.Namespace, threads: int) -> Comparison:
    """Run the same measurement by this command in another process, whose libraries have so many threads."""
    from ...training.benchmarks.child import run_child
    from ...training.benchmarks.threads import environment_of_threads
    from ...training.benchmarks.timing import Comparison

    package = __name__.removesuffix(".commands.benches.decode")
    words = ["bench", "decode", "--json", "--threads", str(threads), "--nodes", str(args.nodes)]
    words += ["--pixels", str(args.pixels), "--repeats", str(args.repeats)]
    words += [str(args.file)] if args.file is not None else []
    words += ["--weights", str(args.weights)] if args.weights is not None else []
    child = run_child([sys.executable, "-m", package, *words], environment_of_threads(threads))
    if child.code:
        raise PatchNetError("The measurement failed: what it said stands above")
    values = json.loads(child.stdout.splitlines()[-1])
    return Comparison(**{name: values.pop(name) for name in ("name", "ours", "peer", "ratio", "unit")}, details=values)


def text(values: dict[str, Any]) -> str:
    """Sentence about the pixels, and a Markdown table of rates."""
    from ...training.benchmarks.tables import markdown_table

    rates = values["pixels_per_s"]
    names = {
        "decode": "ours, whole decode",
        "torch": f"{values['torch']}: layers alone",
        "numpy": "NumPy, whole decode",
        "trace": "tracing the same pixels",
    }
    rows = [
        [title, f"{rates[name]:,.0f}", f"{values['ours'] / rates[name]:.2f}"]
        for name, title in names.items()
        if name in rates
    ]
    return (
        f"{values['octree']}: {values['pixels']:,} pixels, {values['decoded_pixels']:,} of them with look-ahead; "
        f"network: {values['network']}; threads: {values['threads']}, {values['clock']} seconds\n"
        f"{values['gflops']:.0f} GFLOP/s of {values['peak_gflops']:.0f}: {values['share_of_peak']:.0%}\n\n"
        f"{markdown_table(['', 'pixels per second', 'ours to that'], rows)}"
    )
