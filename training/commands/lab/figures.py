# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab figures`: draw the split rendering and refinement patterns of the shuttle, and a table of San Miguel
from several distances with one to three levels of look-ahead, as .png, .svg and .json. Scene files are in the folder
PATCHNET_SCENES.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ....commands.shared.arguments import add_out
from ....commands.shared.lines import say_result
from ....patchnet_addon.runtime.outputs import check_outputs
from ....patchnet_addon.runtime.progress import drain
from ..arguments import named_file

SPLIT, LOOK_AHEAD = FIGURES = ("split", "look-ahead")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("--only", choices=FIGURES, help="draw one figure of the paper (both)")
    parser.add_argument(
        "--octrees", type=Path, metavar="DIR", help="folder of octrees and codes, created if missing (OUT/octrees)"
    )
    parser.add_argument("--weights", type=Path, help="weights file of split (the shipped one)")
    parser.add_argument(
        "--networks", type=named_file, nargs="+", default=(), metavar="NAME=FILE", help="weights files that look-ahead "
        "shows beside the exact scores, under their names, one for each look-ahead",
    )  # fmt: skip
    add_out(parser, "folder for the figures", required=True)


def run(args: argparse.Namespace) -> int:
    """Draw figures and print their paths; returns 0; raises PatchNetError."""
    from ...encoders import load_weights
    from ...evaluation import require

    require()
    from ....commands.shared.progress_lines import progress_lines
    from ...evaluation.catalogue import scene_octree
    from ...evaluation.figures_of_paper.figures import (
        SCENES,
        check_networks,
        figure_files,
        make_look_ahead,
        make_split,
    )

    names = FIGURES if args.only is None else (args.only,)
    files = {args.out / file: kind for name in names for file, kind in figure_files(name).items()}
    inputs = [*(path for _, path in args.networks), *filter(None, [args.weights])]
    check_outputs(files, inputs, folder=args.out)
    args.out.mkdir(parents=True, exist_ok=True)
    # Raise before octrees are created.
    first, networks = load_weights(args.weights), {name: load_weights(path) for name, path in args.networks}
    check_networks(networks.values(), [name for name, _ in args.networks])
    octrees = args.octrees or args.out / "octrees"
    drawn: list[Path] = []
    show = progress_lines()
    paths = {name: scene_octree(SCENES[name], octrees) for name in names}
    if SPLIT in paths:
        drawn += drain(make_split(paths[SPLIT], first, args.out), show)
    if LOOK_AHEAD in paths:
        drawn += drain(make_look_ahead(paths[LOOK_AHEAD], networks, args.out), show)
    say_result(f"{args.out}: {', '.join(path.name for path in drawn)}", file=args.out, figures=list(names))
    return 0
