# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab NAME`: research: scenes and samples to learn from, training, comparison of strategies, figures.

A sub-command is a module of this folder, as those of `commands/` are.
"""

from __future__ import annotations

import argparse

from . import (
    dataset,
    evaluate,
    evaluate_cycles,
    figures,
    furnish,
    train,
    train_maps,
    train_networks,
    train_plus,
    validate,
)

# In the order of the help.
COMMANDS = {
    "furnish": furnish, "dataset": dataset, "train": train, "validate": validate, "train-plus": train_plus,
    "train-networks": train_networks, "train-maps": train_maps, "evaluate": evaluate,
    "evaluate-cycles": evaluate_cycles, "figures": figures,
}  # fmt: skip


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:  # type: ignore[type-arg]
    """Arguments of `patchnet lab`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "lab",
        help="research: train networks, compare strategies, draw figures",
        description="Train networks, compare strategies and draw figures. Needs the extras `train` and `bench`.",
    )
    commands = parser.add_subparsers(dest="lab", metavar="NAME", required=True)
    for command in COMMANDS.values():
        command.add_parser(commands)
    return parser


def run(args: argparse.Namespace) -> int:
    """Run the sub-command; raises PatchNetError."""
    return COMMANDS[args.lab].run(args)
