# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train-networks`: train the networks of the paper on scenes, each on the same budget.

    patchnet lab train-networks --scenes shuttle,sponza,station,san-miguel-bare --samples 2000000 --passes 16000000 --out out/networks

Kinds of networks:

    scene       trained on one scene, with its name
    without     trained on all scenes but one, without-SCENE
    look-ahead  look-ahead-1 and look-ahead-3, trained on all scenes but --unseen
    encoders    conv3d and voxception, trained on all scenes but --unseen; they need torch for encoding

Creates missing octrees of the catalogue's scenes, draws samples, and trains the networks with checkpoints. A later run
skips finished networks and resumes an interrupted one. networks.json has parameters, times, and errors on the
held-out scenes of each network.
"""  # noqa: E501  a command stands on one line

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ...patchnet_addon.network.kinds import KINDS as NETWORK_KINDS
from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.quantities import counted
from ...training.networks_of_paper.plan import KINDS, planned_networks
from ...training.settings import LOSSES, PRESETS, preset_with
from ..shared.arguments import add_device, add_number, add_out, check_octrees
from ..shared.lines import say_result
from ..shared.training_run import require_torch
from .scene_arguments import add_scenes, scenes_named

if TYPE_CHECKING:
    from ...training.evaluation.catalogue import Scene
    from ...training.networks_of_paper.run import NetworksRun

_SAMPLES, _PASSES, _VOXELS = 2_000_000, 16_000_000, 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("octrees", nargs="*", type=Path, metavar="OCTREE", help="octree files beside --scenes")
    add_scenes(parser)
    parser.add_argument(
        "--kinds", default=",".join(KINDS), metavar="KIND,KIND", help=f"kinds of networks ({','.join(KINDS)})"
    )
    parser.add_argument(
        "--unseen", metavar="NAME", help="held-out scene of look-ahead and encoders (the last one)"
    )
    add_number(
        parser, "--samples", bounds.DATASET_SAMPLES, default=_SAMPLES, help=f"samples of each scene ({_SAMPLES:,})"
    )
    add_number(parser, "--least-level", bounds.LEVEL, default=5, help="coarsest level of voxels (5)")
    add_number(parser, "--passes", bounds.PASSES, default=_PASSES, help=f"passes of each network ({_PASSES:,})")
    parser.add_argument("--preset", choices=tuple(PRESETS), default="improved", help="preset of settings (improved)")
    parser.add_argument("--network", choices=tuple(NETWORK_KINDS), help="kind of network; paper, with --loss absolute")
    parser.add_argument("--loss", choices=LOSSES, help="error to minimize")
    add_number(parser, "--seed", bounds.SEED, default=0, help="random seed of samples and trainings (0)")
    add_number(
        parser, "--voxels", bounds.DATASET_SAMPLES, default=_VOXELS, help=f"voxels of a scene for errors ({_VOXELS:,})"
    )
    add_device(parser, "device for training; auto: a GPU if torch has one (auto)")
    add_number(parser, "--threads", bounds.THREADS, help="threads of the CPU (all cores)")
    add_number(parser, "--checkpoint-minutes", bounds.CHECKPOINT_MINUTES, default=5.0, help="time between checkpoints")
    add_out(parser, "folder for octrees, samples and networks", required=True)


def run(args: argparse.Namespace) -> int:
    """Train missing networks and write networks.json; returns 0; raises PatchNetError."""
    from ...patchnet_addon.runtime.file_kinds import NETWORKS
    from ...patchnet_addon.runtime.outputs import check_outputs
    from ...training.evaluation.catalogue import scene_octree
    from ...training.networks_of_paper.plan import VALUES, octrees_folder
    from ..shared.progress_bars import ProgressBars

    check_octrees(args.octrees)
    scenes = _scenes(args)
    names = [*(scene.name for scene in scenes), *(path.stem for path in args.octrees)]
    plans = planned_networks(names, _words(args.kinds), args.unseen)
    if not plans:
        raise SettingError("There is nothing to train: name --kinds of networks")
    check_outputs({args.out / VALUES: NETWORKS}, args.octrees, folder=args.out)
    require_torch()
    from ...training.networks_of_paper.run import train_networks, write_rows

    work = _work(args)
    args.out.mkdir(parents=True, exist_ok=True)
    with ProgressBars() as bars:
        octrees = {scene.name: scene_octree(scene, octrees_folder(args.out)) for scene in scenes}
        octrees |= {path.stem: path for path in args.octrees}
        rows = drain(train_networks(octrees, plans, work), bars.show)
    write_rows(
        args.out,
        {"samples": args.samples, "least_level": args.least_level, "voxels": args.voxels} | asdict(work.settings),
        rows,
    )
    say_result(f"{args.out}: {counted(len(rows), 'network')}", file=args.out, networks=len(rows))
    return 0


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _scenes(args: argparse.Namespace) -> list[Scene]:
    """Named scenes of the catalogue; raises SettingError without scenes and octrees."""

    if not args.scenes and not args.octrees:
        raise SettingError("There is nothing to train on: name --scenes, or octree files")
    return scenes_named(args.scenes) if args.scenes else []


def _work(args: argparse.Namespace) -> NetworksRun:
    """Budget and settings of the run; raises SettingError for a missing device."""
    from ...patchnet_addon.network.devices import found_device
    from ...training.networks_of_paper.run import NetworksRun
    from ...training.run.provenance import run_notes
    from ...training.run.trainer import RunOptions

    device = found_device(args.device, "--device")
    changes = {"passes": args.passes, "seed": args.seed, "network": args.network, "loss": args.loss}
    settings = preset_with(args.preset, changes)
    options = RunOptions(
        args.out, checkpoint_minutes=args.checkpoint_minutes, notes=run_notes(device), device=device,
        threads=args.threads,
    )  # fmt: skip
    return NetworksRun(args.samples, args.least_level, settings, args.voxels, options)
