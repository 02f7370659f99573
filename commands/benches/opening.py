# SPDX-License-Identifier: GPL-3.0-or-later
"""Time opening an octree file, with all its checks, against NumPy reading the same arrays; file cache warm."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ..shared.arguments import add_number
from .arguments import add_repeats

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "opening an octree file against numpy.load"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench open`."""
    parser.add_argument("file", type=Path, nargs="?", help="octree file (one of --nodes nodes is made)")
    add_number(parser, "--nodes", bounds.NODES, default=10_000_000, help="nodes of the octree that is made (10000000)")
    add_repeats(parser, 7)


def measure(args: argparse.Namespace) -> Comparison:
    """Seconds of both; raises PatchNetError for a file that is no octree."""
    from ...patchnet_addon.octree.file import save_octree
    from ...training.benchmarks.opening import benchmark_opening
    from ...training.benchmarks.shells import octree_of_shells

    with tempfile.TemporaryDirectory(prefix="patchnet-") as folder:
        path = args.file
        if path is None:
            path = Path(folder) / "shells.safetensors"
            save_octree(octree_of_shells(args.nodes), path)
        result = benchmark_opening(path, Path(folder), args.repeats)
        return replace(result, details={"file": path.name, **result.details})


def text(values: dict[str, Any]) -> str:
    """Return the figures as one sentence."""
    return (
        f"{values['file']}: {values['nodes']:,} nodes, {values['file_bytes'] / 2**20:.1f} MiB, open and checked in "
        f"{values['ours']:.3f} s, {values['peer_name']} {values['peer']:.3f} s, ratio {values['ratio']:.2f}; "
        f"mapped in {values['map_s']:.4f} s, with checksums {values['map_and_checksums_s']:.3f} s"
    )
