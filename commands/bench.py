# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet bench NAME`: measure a part of PatchNet against another program, in one run and on the same input.

A bench is a module of `commands/benches/`:

    HELP                        what is measured against what
    add_arguments(parser)       its arguments, without --json
    measure(args) -> Comparison the measurement
    text(values) -> str         its figures for the user, from the values of the JSON
"""

from __future__ import annotations

import argparse
import json

from . import add_commands
from .benches import bake, decode, encode, frame, trace, train, voxelize, walkthrough

BENCHES = {
    "voxelize": voxelize, "trace": trace, "encode": encode, "decode": decode, "frame": frame, "bake": bake,
    "walkthrough": walkthrough, "train": train,
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the benches, each with --json."""
    helps = {name: bench.HELP for name, bench in BENCHES.items()}
    for single in add_commands(parser, "bench", f"{__package__}.benches", helps).values():
        single.add_argument("--json", action="store_true", help="print one line of JSON")
        single.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure and print; returns 0; raises PatchNetError."""
    bench = BENCHES[args.bench]
    values = bench.measure(args).as_json()
    print(json.dumps(values) if args.json else bench.text(values))
    return 0
