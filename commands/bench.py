# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet bench NAME`: measure against other programs, in the same run and on the same input.

A bench is a module of `commands/benches/`:

    HELP                        what is measured against what
    add_arguments(parser)       its arguments, without --json
    measure(args) -> Comparison the measurement
    text(values) -> str         its figures for the user, from the values of the JSON
"""

from __future__ import annotations

import argparse
import json

from .benches import bake, decode, encode, frame, trace, train, voxelize, walkthrough

BENCHES = {
    "voxelize": voxelize, "trace": trace, "encode": encode, "decode": decode, "frame": frame, "bake": bake,
    "walkthrough": walkthrough, "train": train,
}  # fmt: skip


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:  # type: ignore[type-arg]
    """Arguments of `patchnet bench`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "bench",
        help="measure against other programs",
        description="Measure a part of PatchNet against another program, in the same run and on the same input.",
    )
    benches = parser.add_subparsers(dest="bench", metavar="NAME", required=True)
    for name, bench in BENCHES.items():
        single = benches.add_parser(name, help=bench.HELP, description=bench.__doc__)
        bench.add_arguments(single)
        single.add_argument("--json", action="store_true", help="print one line of JSON")
    return parser


def run(args: argparse.Namespace) -> int:
    """Measure and print; returns 0; raises PatchNetError."""
    bench = BENCHES[args.bench]
    values = bench.measure(args).as_json()
    print(json.dumps(values) if args.json else bench.text(values))
    return 0
