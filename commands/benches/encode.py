# SPDX-License-Identifier: GPL-3.0-or-later
"""Time the encoder on our products against NumPy's and torch's: corners per second, and GFLOP/s of the products."""

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
from .arguments import add_cores, add_repeats

if TYPE_CHECKING:
    from ...patchnet_addon.octree.octree import Octree
    from ...training.benchmarks.timing import Comparison

HELP = "the encoder on our compiled products against NumPy's and torch's, and against the peak of products"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench encode`."""
    parser.add_argument("file", type=Path, nargs="?", help="octree file (one of --nodes nodes is made)")
    add_number(parser, "--nodes", bounds.NODES, default=600_000, help="nodes of the octree that is made (600000)")
    parser.add_argument("--weights", type=Path, help="weights file (those that are shipped)")
    add_number(parser, "--corners", bounds.CORNERS, default=50_000, help="corners to encode, about (50000)")
    add_cores(parser)
    add_number(parser, "--threads", bounds.THREADS, help="threads of ours and of torch, wall seconds (all of --cores)")
    add_repeats(parser, 9)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of all; one core is measured in a process that has one thread; raises PatchNetError."""
    from ...patchnet_addon.network.weights import load_weights
    from ...patchnet_addon.runtime.threads import usable_cores
    from ...training.benchmarks.encoding import benchmark_encoding
    from ...training.benchmarks.threads import has_threads

    threads = args.threads or (usable_cores() if args.cores == "all" else 0)
    if not threads and not has_threads(1):
        return _in_a_process_of_one_thread(args)
    octree = _octree(args)
    result = benchmark_encoding(octree, load_weights(args.weights), args.corners, args.repeats, threads=threads)
    name = args.file.name if args.file is not None else "shells"
    return replace(result, details={"octree": name, "nodes": octree.node_count, **result.details})


def _octree(args: argparse.Namespace) -> Octree:
    from ...patchnet_addon.octree.file import load_octree
    from ...training.benchmarks.shells import octree_of_shells

    return load_octree(args.file) if args.file is not None else octree_of_shells(args.nodes)


def _in_a_process_of_one_thread(args: argparse.Namespace) -> Comparison:
    """Run the same measurement by this command in another process, on one thread."""
    from ...training.benchmarks.child import run_child
    from ...training.benchmarks.threads import environment_of_threads
    from ...training.benchmarks.timing import Comparison

    package = __name__.removesuffix(".commands.benches.encode")
    words = ["bench", "encode", "--json", "--cores", "one", "--nodes", str(args.nodes)]
    words += ["--corners", str(args.corners), "--repeats", str(args.repeats)]
    words += ["--weights", str(args.weights)] if args.weights is not None else []
    words += [str(args.file)] if args.file is not None else []
    child = run_child([sys.executable, "-m", package, *words], environment_of_threads(1))
    if child.code:
        raise PatchNetError("The measurement on one core failed: what it said stands above")
    values = json.loads(child.stdout.splitlines()[-1])
    return Comparison(**{name: values.pop(name) for name in ("name", "ours", "peer", "ratio", "unit")}, details=values)


def text(values: dict[str, Any]) -> str:
    """Sentence about corners, and a Markdown table of products."""
    from ...training.benchmarks.tables import markdown_table

    operations, shares = values["operations_per_corner"], values["share_of_peak"]
    names = ["ours", "ours_on_its_values", "numpy"] + (["torch"] if values["torch"] else [])
    head = ["rows", "matrix", "zeros", "ours, no zeros", "ours, its values", values["peer_name"], values["torch"]]
    rows = [
        [f"{row['rows']:,}", f"{row['depth']} x {row['columns']}", f"{row['zeros']:.0%}"]
        + [f"{row[name]:.1f}" for name in names]
        for row in values["products"]
    ]
    rates = values["corners_per_s"]
    others = "".join(
        f", {title} {rates[name]:,.0f} (ratio {values['ours'] / rates[name]:.2f})"
        for name, title in (
            ("numpy", values["peer_name"]), ("torch", values["torch"]), ("torch_plain", "torch's plain layers")
        )
        if name in rates
    )  # fmt: skip
    measured = f"{values['clock']} seconds, threads: {values['threads']}"
    peak = (
        f"Peak of products ({values['peak_name']}, same run): {values['peak_gflops']:.0f} GFLOP/s. Operations of a "
        f"corner: {operations['needed'] / 1e6:.2f} M needed, {operations['not_zero'] / 1e6:.2f} M with values that are "
        f"not 0, {operations['plain'] / 1e6:.2f} M of plain layers"
    )
    reached = "; ".join(f"{name} {share['needed']:.2f} and {share['not_zero']:.2f}" for name, share in shares.items())
    memory = (
        f"Memory: {values['scratch_bytes'] / 2**20:.1f} MiB beside the result at the peak; "
        f"{values['index_bytes_per_voxel']:.2f} B beside the codes for each of {values['coded_voxels']:,} coded voxels"
    )
    return (
        f"{values['octree']}: {values['corners']:,} corners of {values['blocks']:,} blocks, "
        f"{values['occupied_cells']:.0%} of their cells occupied\n"
        f"Corners per second: ours {values['ours']:,.0f}{others} ({measured})\n"
        f"Whole octree, corners found and codes stored: {values['octree_corners_per_s']:,.0f} of "
        f"{values['all_corners']:,} corners per second\n"
        f"{peak}\nShares of the peak, of needed operations and of those with values that are not 0: {reached}\n"
        f"{memory}\n\n"
        f"GFLOP/s of a chunk's products, zeros counted\n\n{markdown_table(head[: 3 + len(names)], rows)}"
    )
