# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train-plus`: train the estimator of pixel errors that the strategies patchnet-plus rank by.

Frames of camera tracks of the octrees are rendered, with references. All forms, and the same without the network, are
trained at once, within minutes:

    patchnet lab train-plus OCTREE... --weights run/patchnet.safetensors --out plus
    patchnet run SCENE --weights plus/patchnet.safetensors

The weights file in --out holds both the given weights and the estimator, which is used wherever that file is.
The octrees should be those that PatchNet's weights were trained on, or others, but none that is evaluated.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ....commands.shared.arguments import add_number, add_out
from ....commands.shared.lines import say_result
from ....patchnet_addon.runtime import bounds
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.outputs import check_outputs
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.quantities import counted
from ... import bounds as lab_bounds
from ..arguments import check_octrees
from ..training_run import require_torch, say_written
from .scene_arguments import add_track, track_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("octrees", nargs="+", type=Path, metavar="OCTREE", help="octree files to train on")
    parser.add_argument("--weights", type=Path, help="weights of PatchNet (the shipped ones)")
    add_out(parser, "folder for weights and log", required=True)
    add_number(parser, "--steps", lab_bounds.STOP_AFTER, "steps of training", 20_000)
    add_number(parser, "--batch", lab_bounds.BATCH, "pixels per step", 2048)
    add_number(parser, "--pixels", lab_bounds.FRAME_PIXELS, "pixels per frame", 2000)
    add_number(parser, "--rate", lab_bounds.LEARNING_RATE, "learning rate", 3e-3)
    add_number(parser, "--every", lab_bounds.TRACK_FRAMES, "train on every Nth frame of a track", 40)
    add_number(parser, "--rays", bounds.RAYS, "rays per pixel side of references", 16)
    add_track(parser, "tracks, pixels and weights")
    add_number(parser, "--threads", lab_bounds.THREADS, "threads that train", 1)


def run(args: argparse.Namespace) -> int:
    """Render frames, train, and print the path of the weights; returns 0; raises PatchNetError."""
    check_octrees(args.octrees)
    if len({path.resolve() for path in args.octrees}) < len(args.octrees):
        raise SettingError("An octree is named twice: name each file once")
    require_torch()
    import torch

    from ....commands.shared.progress_lines import progress_lines
    from ....patchnet_addon.network.weights import save_weights
    from ....patchnet_addon.octree.file import load_octree, octree_hash
    from ....patchnet_addon.sampling.plus.weights import load_estimators, with_estimators
    from ...encoders import load_weights
    from ...plus.frames import PixelTable, pixels_of
    from ...plus.train import RUN_FILES, PlusSettings, train_plus
    from ...run.provenance import describe_commit, run_notes
    from ...run.run_files import LOG, WEIGHTS, log_lines
    from ...run.trainer import RunOptions

    inputs = [*args.octrees, *filter(None, [args.weights])]
    check_outputs({args.out / name: kind for name, kind in RUN_FILES.items()}, inputs, folder=args.out)
    torch.set_num_threads(args.threads)
    weights = load_weights(args.weights)
    settings = PlusSettings(args.steps, args.batch, args.pixels, args.rate, args.seed)
    tracks = track_settings(args, args.every)
    octrees = {path.name: octree_hash(load_octree(path)) for path in args.octrees}
    notes = run_notes() | {"commit": describe_commit(), "patchnet": weights.hash, "octrees": octrees}
    show = progress_lines()
    parts = [drain(pixels_of(path, weights, tracks, args.rays, args.pixels), show) for path in args.octrees]
    table = PixelTable.joined(parts)
    path = drain(train_plus(table, settings, RunOptions(args.out, log_steps=100, notes=notes)), show)
    save_weights(with_estimators(weights, load_estimators(path)), args.out / WEIGHTS)
    losses = log_lines(args.out / LOG)[-1]["loss"]
    print(f"Losses, where 1 is a constant guess: {', '.join(f'{name} {loss:.3f}' for name, loss in losses.items())}")
    say_written(args.out, RUN_FILES)
    text = f"{args.out / WEIGHTS}: weights and their estimator, trained on {counted(len(table), 'pixel')}"
    say_result(text, file=args.out / WEIGHTS, pixels=len(table))
    return 0
