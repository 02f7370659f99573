# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples per second of both kinds of network, on the CPU, and on a GPU beside it.

A step is all that a run does again and again: batches are gathered, gradients computed, the optimiser's step taken.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.network.encoders import MLP
from ...patchnet_addon.runtime import bounds
from ...training.settings import AUTO, BF16, FP32
from ..shared.arguments import add_device, add_number
from ..shared.training_run import require_torch
from .arguments import add_repeats

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "training samples per second, on a GPU against the CPU"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench train`."""
    parser.add_argument(
        "datasets", nargs="*", type=Path, metavar="DATASET",
        help="sample files, or folders of them (samples of an octree of --nodes nodes are drawn)",
    )  # fmt: skip
    add_device(parser, "what trains; auto: a GPU where torch has one (auto)")
    add_number(parser, "--nodes", bounds.NODES, default=1_000_000, help="nodes of the octree that is made (1000000)")
    add_number(
        parser, "--samples", bounds.DATASET_SAMPLES, default=400_000, help="samples that are drawn of it (400000)"
    )
    add_number(
        parser, "--threads", bounds.THREADS, help="threads that train, or gather batches for a GPU (all cores)"
    )
    parser.add_argument(
        "--precision", choices=(AUTO, BF16, FP32), default=AUTO,
        help="of the encoder's products (auto: bf16 where the processor has it)",
    )  # fmt: skip
    add_number(
        parser, "--encoder-width", bounds.ENCODER_WIDTH, default=MLP.width,
        help=f"values between the encoder's layers ({MLP.width})",
    )  # fmt: skip
    add_repeats(parser, 9)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of both kinds of network; raises PatchNetError."""
    require_torch()
    from ...patchnet_addon.network.devices import found_device
    from ...patchnet_addon.runtime.threads import usable_cores
    from ...training.benchmarks.training_rate import TrainBench, benchmark_training
    from ...training.data.dataset import load_dataset, sample_files

    datasets = [load_dataset(path) for path in sample_files(args.datasets)]
    return benchmark_training(
        datasets,
        TrainBench(
            args.nodes,
            args.samples,
            repeats=args.repeats,
            device=found_device(args.device, "--device"),
            threads=args.threads or usable_cores(),
            precision=args.precision,
            encoder_width=args.encoder_width,
        ),
    )


def text(values: dict[str, Any]) -> str:
    """Markdown table of both kinds."""
    from ...training.benchmarks.tables import markdown_table

    rows = [
        [
            row["kind"], row["device"], f"{row['batch']:,}", row["precision"], f"{row['step_ms']:.1f}",
            f"{row['samples_per_s']:,.0f}", f"{row['samples_per_processor_s']:,.0f}",
        ]
        for row in values["rows"]
    ]  # fmt: skip
    head = ["network", "device", "samples a step", "precision", "step, ms", "samples/s", "samples/s of the processor"]
    return (
        f"{values['machine']}; {values['versions']}\n"
        f"Threads: {values['threads']}, medians of {values['repeats']} runs\n\n"
        f"{markdown_table(head, rows)}"
    )
