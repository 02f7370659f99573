# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train-maps`: train the sampling-map networks of the literature, PatchNet's rivals.

Frames of camera tracks of the octrees are rendered once and reused by networks with the same --frames-folder:

    patchnet lab train-maps OCTREE... --network unet --steps 20000 --frames-folder frames --out unet
    patchnet lab evaluate OCTREE... --maps unet/sampling_map.safetensors --out results

Train on octrees of other scenes than those of the evaluation.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ....commands.shared.arguments import add_number, add_out
from ....commands.shared.lines import say_result
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.quantities import counted
from ... import bounds
from ...evaluation.networks import NAMES
from ...run.run_files import check_run
from ..arguments import check_octrees
from ..training_run import add_run_arguments, require_torch
from .scene_arguments import add_track, track_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("octrees", nargs="+", type=Path, metavar="OCTREE", help="octree files to train on")
    parser.add_argument("--network", choices=NAMES, required=True, help="weiss: WITW20; kuznetsov: KKR18; unet: ours")
    add_number(parser, "--steps", bounds.STOP_AFTER, "steps of training", required=True)
    add_out(parser, "folder for checkpoint, log and weights", required=True)
    parser.add_argument(
        "--frames-folder", type=Path, metavar="FOLDER", help="folder of rendered frames (frames in --out)"
    )
    add_number(parser, "--every", bounds.TRACK_FRAMES, "train on every Nth frame of a track", 10)
    add_track(parser, "tracks, weights and crops")
    add_number(parser, "--batch", bounds.BATCH, "crops per step (16 of weiss, else 6)")
    add_number(parser, "--crop", bounds.CROP, "pixels along a crop's side (32 of weiss, else 96)")
    add_number(parser, "--rate", bounds.LEARNING_RATE, "learning rate", 1e-4)
    add_run_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Render missing frames, train, and print the path of the weights; returns 0; raises PatchNetError."""
    from ...evaluation.networks.maps import FRAMES, RUN_FILES

    check_run(args.out, args.octrees, resume=args.resume, kinds=RUN_FILES)
    check_octrees(args.octrees)
    require_torch()
    import torch

    from ....commands.shared.progress_lines import progress_lines
    from ....patchnet_addon.network.devices import found_device
    from ...evaluation.map_frames import rendered_frames
    from ...evaluation.networks.train_maps import MapSettings, train_maps
    from ...run.provenance import run_notes
    from ...run.trainer import RunOptions

    device = found_device(args.device, "--device")
    if args.threads is not None:
        torch.set_num_threads(args.threads)
    settings = MapSettings(args.network, args.steps, args.batch or 0, args.crop or 0, args.rate, args.seed)
    tracks = track_settings(args, args.every)
    options = RunOptions(
        args.out, args.resume, stop_after=args.stop_after, device=device, notes=run_notes(device)
    )  # fmt: skip
    show = progress_lines()
    frames, key = drain(rendered_frames(args.octrees, tracks, args.frames_folder or args.out / FRAMES), show)
    path = drain(train_maps(frames, key, settings, options), show)
    say_result(f"{path}: trained on {counted(len(frames), 'frame')}", file=path, frames=len(frames))
    return 0
