# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples per second on the CPU, against the rate that a step's matrix products alone would allow.

Torch does the products of some of the steps alone in the same run, whole, with their sizes, strides and number types,
in as many threads. One thread is measured in processor seconds on one core. In matrix units (AMX) products take a sixth
of the time, so their share of a step is smaller there; ONEDNN_MAX_CPU_ISA=AVX512_CORE_BF16 measures without them. The
last columns have a step's products in float32, which need neither: the ceiling of training without bfloat16.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...patchnet_addon.network.encoders import MLP
from ...patchnet_addon.runtime import bounds
from ...training.settings import AUTO, BF16, FP32
from ..shared.arguments import add_number
from ..shared.training_run import require_torch
from .arguments import add_repeats

if TYPE_CHECKING:
    from ...training.benchmarks.timing import Comparison

HELP = "whole training steps against their matrix products alone"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `patchnet bench train`."""
    parser.add_argument(
        "datasets", nargs="*", type=Path, metavar="DATASET",
        help="sample files, or folders of them (samples of an octree of --nodes nodes are drawn)",
    )  # fmt: skip
    add_number(parser, "--nodes", bounds.NODES, default=1_000_000, help="nodes of the octree that is made (1000000)")
    add_number(
        parser, "--samples", bounds.DATASET_SAMPLES, default=400_000, help="samples that are drawn of it (400000)"
    )
    add_number(parser, "--threads", bounds.THREADS, default=1, help="threads that learn, or multiply (1)")
    parser.add_argument(
        "--precision", choices=(AUTO, BF16, FP32), default=AUTO,
        help="of the encoder's products (auto: bf16 where the processor has it)",
    )  # fmt: skip
    add_number(
        parser, "--encoder-width", bounds.ENCODER_WIDTH, default=MLP.width,
        help=f"values between the encoder's layers ({MLP.width}): the wider, the more of a step is products",
    )  # fmt: skip
    add_repeats(parser, 9)


def measure(args: argparse.Namespace) -> Comparison:
    """Rates of both kinds of network; raises PatchNetError."""
    from ...training.data.dataset import load_dataset, sample_files
    from ..shared.training_run import keep_freed_memory

    keep_freed_memory()
    require_torch()
    from ...training.benchmarks.training_rate import TrainBench, benchmark_training

    datasets = [load_dataset(path) for path in sample_files(args.datasets)]
    return benchmark_training(
        datasets,
        TrainBench(
            args.nodes,
            args.samples,
            repeats=args.repeats,
            threads=args.threads,
            precision=args.precision,
            encoder_width=args.encoder_width,
        ),
    )


def text(values: dict[str, Any]) -> str:
    """Markdown table of both kinds."""
    from ...training.benchmarks.tables import markdown_table

    rows = [
        [
            name, f"{row['batch']:,}", row["precision"], f"{row['samples_per_s']:,.0f}",
            f"{row['products_samples_per_s']:,.0f}", f"{row['share']:.0%}", f"{row['step_ms']:.1f}",
            f"{row['products_ms']:.1f}", f"{row['gflops_of_products']:,.0f}",
            f"{row['float32_products_samples_per_s']:,.0f}", f"{row['share_of_float32']:.0%}",
            f"{row['gflops_of_float32_products']:,.0f}",
        ]
        for name, row in values["kinds"].items()
    ]  # fmt: skip
    head = [
        "network", "samples a step", "precision", "samples/s", "by products alone", "share", "step, ms", "products, ms",
        "GFLOP/s of products", "by float32 products alone", "share of that", "their GFLOP/s",
    ]  # fmt: skip
    units = "with" if values["matrix_units"] else "without"
    return (
        f"{values['machine']}, {units} matrix units; {values['versions']}\n"
        f"Threads: {values['threads']}, {values['clock']} seconds, medians of {values['repeats']} runs\n\n"
        f"{markdown_table(head, rows)}"
    )
