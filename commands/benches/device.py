# SPDX-License-Identifier: GPL-3.0-or-later
"""Codes and training samples per second on a GPU by torch, beside the CPU in the same run."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SettingError
from ..shared.arguments import add_device, add_number
from .arguments import add_repeats

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "encoding and training on a GPU against the CPU"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench device`."""
    add_device(parser, "what is measured; cpu: torch there, against our own kernels (auto)")
    add_number(parser, "--nodes", bounds.NODES, default=10_000_000, help="nodes of the octree that is made (10000000)")
    add_number(parser, "--corners", bounds.CORNERS, default=200_000, help="corners of the network alone (200000)")
    add_number(
        parser, "--samples", bounds.DATASET_SAMPLES, default=200_000, help="training samples that are drawn (200000)"
    )
    add_number(parser, "--threads", bounds.THREADS, help="threads of the CPU that train or gather (all cores)")
    add_repeats(parser, 5)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of both; raises SettingError for a device that is not there."""
    from ...patchnet_addon.network.devices import found_device, has_torch
    from ...patchnet_addon.network.weights import load_weights

    if not has_torch():
        raise SettingError("This bench needs torch: install it with `pip install 'patchnet-blender[train]'`")
    device = found_device(args.device, "--device")
    from ...training.benchmarks.device import DeviceBench, benchmark_device
    from ...training.benchmarks.shells import octree_of_shells

    bench = DeviceBench(device, args.corners, args.samples, args.repeats, args.threads)
    return benchmark_device(octree_of_shells(args.nodes), load_weights(), bench)


def text(values: dict[str, Any]) -> str:
    """Markdown table of rates, and how far results are apart."""
    from ...training.benchmarks.tables import markdown_table

    rows = [
        [row["what"], f"{row['device']:,.0f}", f"{row['cpu']:,.0f}", f"{row['ratio']:.2f}", row["unit"]]
        for row in values["measured"]
    ]
    apart = ", ".join(f"{name} {value:.2g}" for name, value in values["differences"].items())
    return (
        f"{values['device']} beside {values['machine']}; {values['versions']}\n"
        f"Octree of {values['nodes']:,} nodes, {values['codes']:,} codes; medians of {values['repeats']} runs, wall "
        f"seconds, {values['threads']} threads; finding corners, which encoding does on the CPU: "
        f"{values['finding_corners_s']:.2f} s\n\n"
        f"{markdown_table(['', values['device'], 'CPU', 'ratio', 'unit'], rows)}\n\n"
        f"Largest differences: {apart}"
    )
