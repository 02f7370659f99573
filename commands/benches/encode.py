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

HELP = "the encoder on our compiled products against NumPy's and torch's"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench encode`."""
    parser.add_argument("file", type=Path, nargs="?", help="octree file (one of --nodes nodes is made)")
    add_number(parser, "--nodes", bounds.NODES, default=600_000, help="nodes of the octree that is made (600000)")
    add_number(parser, "--corners", bounds.CORNERS, default=50_000, help="corners to encode, about (50000)")
    add_cores(parser)
    add_repeats(parser, 9)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of all; one core is measured in a process that has one thread; raises PatchNetError."""
    from ...patchnet_addon.network.weights import load_weights
    from ...training.benchmarks.encoding import benchmark_encoding
    from ...training.benchmarks.threads import has_threads

    all_cores = args.cores == "all"
    if not all_cores and not has_threads(1):
        return _in_a_process_of_one_thread(args)
    octree = _octree(args)
    result = benchmark_encoding(octree, load_weights(), args.corners, args.repeats, all_cores=all_cores)
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
    words += [str(args.file)] if args.file is not None else []
    child = run_child([sys.executable, "-m", package, *words], environment_of_threads(1))
    if child.code:
        raise PatchNetError("The measurement on one core failed: what it said stands above")
    values = json.loads(child.stdout.splitlines()[-1])
    return Comparison(**{name: values.pop(name) for name in ("name", "ours", "peer", "ratio", "unit")}, details=values)


def text(values: dict[str, Any]) -> str:
    """Sentence about corners, and a Markdown table of products."""
    from ...training.benchmarks.tables import markdown_table

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
        for name, title in (("numpy", values["peer_name"]), ("torch", values["torch"]))
        if name in rates
    )
    measured = f"{values['clock']} seconds, cores: {values['cores']}"
    return (
        f"{values['octree']}: {values['corners']:,} corners of {values['blocks']:,} blocks, "
        f"{values['occupied_cells']:.0%} of their cells occupied\n"
        f"Corners per second: ours {values['ours']:,.0f}{others} ({measured})\n\n"
        f"GFLOP/s of a chunk's products, zeros counted\n\n{markdown_table(head[: 3 + len(names)], rows)}"
    )
