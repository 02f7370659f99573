# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab dataset`: draw training samples from octrees."""

from __future__ import annotations

import argparse
from pathlib import Path

from ....commands.shared.arguments import add_number, add_out
from ....patchnet_addon.runtime import bounds
from ....patchnet_addon.runtime.quantities import counted
from ... import bounds as lab_bounds
from ...settings import SAMPLES, VIEWS
from ..arguments import check_octrees


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("octrees", nargs="+", type=Path, metavar="OCTREE", help="octree files, one per scene")
    text = "total samples (views), the same number for each octree"
    add_number(parser, "--samples", lab_bounds.DATASET_SAMPLES, text, SAMPLES)
    add_out(parser, "folder for the sample files", required=True)
    add_number(parser, "--seed", bounds.SEED, "random seed", 0)
    text = "views per voxel: more are faster to train on, but less diverse"
    add_number(parser, "--views", lab_bounds.DATASET_VIEWS, text, VIEWS)
    add_number(parser, "--least-level", bounds.LEVEL, "coarsest level of voxels", 5)
    text = "levels of look-ahead of the samples, and of weights trained on them"
    add_number(parser, "--lookahead", bounds.LOOKAHEAD, text, bounds.DEFAULT_LOOKAHEAD)
    add_number(parser, "--held-out", lab_bounds.HELD_OUT, "share of each scene kept for validation", 0.05)


def run(args: argparse.Namespace) -> int:
    """Draw the samples and write one file per octree."""
    import time

    from ....commands.shared.lines import say_result
    from ....commands.shared.progress_lines import progress_lines
    from ....patchnet_addon.runtime.outputs import check_outputs
    from ....patchnet_addon.runtime.progress import drain
    from ...data.dataset import DATASET_SEEDS, SUFFIX, draw_dataset, sample_names
    from ...data.voxel_choice import SampleSettings
    from ...file_kinds import SAMPLES

    check_octrees(args.octrees)
    names = sample_names(args.octrees)
    check_outputs({args.out / (name + SUFFIX): SAMPLES for name in names}, args.octrees, folder=args.out)
    args.out.mkdir(parents=True, exist_ok=True)
    share = -(-args.samples // len(names))
    start, drawn = time.monotonic(), 0
    for number, (name, path) in enumerate(names.items()):
        settings = SampleSettings(
            views=args.views,
            min_level=args.least_level,
            held_out=args.held_out,
            seed=args.seed + DATASET_SEEDS * number,
            lookahead=args.lookahead,
        )
        samples = drain(draw_dataset(path, share, settings, args.out / (name + SUFFIX)), progress_lines())
        drawn += samples.views.shape[0] * samples.views.shape[1]
    seconds = time.monotonic() - start
    text = f"{counted(drawn, 'sample')} of {counted(len(names), 'octree')} in {seconds:.0f} s"
    text += f" ({drawn / seconds:,.0f}/s)"
    say_result(text, file=args.out, samples=drawn)
    return 0
