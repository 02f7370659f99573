# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab NAME`: research: train networks, compare strategies, draw figures.

Needs the extras `train` and `bench`. Each sub-command is a module of this folder.
"""

from __future__ import annotations

import argparse

from ....commands import add_commands

# Short helps, in the order of the help.
NAMES = {
    "furnish": "compose a furnished room or a garden",
    "dataset": "draw training samples from octrees",
    "train": "train PatchNet on sample files",
    "validate": "errors of weights on samples of scenes",
    "train-plus": "train the estimator of pixel errors",
    "train-maps": "train the sampling-map networks of the literature",
    "evaluate": "compare all strategies on camera tracks of scenes",
    "evaluate-cycles": "compare all strategies against renders by Cycles",
    "figures": "draw figures of the paper from our own scenes",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the sub-commands."""
    add_commands(parser.add_subparsers(dest="lab", metavar="NAME", required=True), __name__, NAMES)
