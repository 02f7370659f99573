# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train-networks`: train the networks of the paper on scenes, each on the same budget.

    patchnet lab train-networks --scenes shuttle,sponza,station,san-miguel-bare --samples 2000000 --passes 16000000 --out out/networks

Kinds of networks:

    scene       one of each scene alone, named after it
    without     one of all scenes but each, without-SCENE
    look-ahead  look-ahead-1 and look-ahead-3, of all scenes but --unseen
    encoders    conv3d and voxception, of all scenes but --unseen; they need torch wherever they are used

Octrees of the catalogue's scenes are made where they are missing, samples drawn, networks trained with checkpoints.
What is done is skipped in a later run, and what was interrupted goes on. networks.json and networks.md have parameters,
times, and errors on the scenes that a network did not see. At the end the lines are printed that evaluate the networks.
"""  # noqa: E501  a command stands on one line

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ...patchnet_addon.network.encoders import MLP
from ...patchnet_addon.network.kinds import KINDS as NETWORK_KINDS
from ...patchnet_addon.runtime import bounds
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.quantities import counted
from ...training.networks_of_paper.plan import KINDS, planned_networks
from ...training.settings import LOSSES, PRESETS, preset_with
from .. import main
from ..shared.arguments import add_device, add_number, add_out, check_octrees
from ..shared.lines import say_result
from ..shared.training_run import require_torch
from .scene_arguments import add_scenes, scenes_named

if TYPE_CHECKING:
    from ...training.evaluation.catalogue import Scene
    from ...training.networks_of_paper.plan import NetworkPlan
    from ...training.networks_of_paper.run import NetworksRun

_SAMPLES, _PASSES, _VOXELS, _EVERY = 2_000_000, 16_000_000, 4096, 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("octrees", nargs="*", type=Path, metavar="OCTREE", help="octree files beside --scenes")
    add_scenes(parser)
    parser.add_argument(
        "--kinds", default=",".join(KINDS), metavar="KIND,KIND", help=f"kinds of networks ({','.join(KINDS)})"
    )
    parser.add_argument(
        "--unseen", metavar="NAME", help="scene that networks of look-ahead and encoders do not see (the last one)"
    )
    add_number(
        parser, "--samples", bounds.DATASET_SAMPLES, default=_SAMPLES, help=f"samples of each scene ({_SAMPLES:,})"
    )
    add_number(parser, "--least-level", bounds.LEVEL, default=5, help="coarsest level of voxels that is learned (5)")
    add_number(parser, "--passes", bounds.PASSES, default=_PASSES, help=f"passes of each network ({_PASSES:,})")
    parser.add_argument("--preset", choices=tuple(PRESETS), default="improved", help="of the trainings (improved)")
    parser.add_argument("--network", choices=tuple(NETWORK_KINDS), help="kind of network; paper, with --loss absolute")
    parser.add_argument("--loss", choices=LOSSES, help="errors that are made small")
    add_number(parser, "--seed", bounds.SEED, default=0, help="random seed of samples and trainings (0)")
    add_number(
        parser, "--voxels", bounds.DATASET_SAMPLES, default=_VOXELS, help=f"of a scene that errors are of ({_VOXELS:,})"
    )
    add_device(parser, "what trains; auto: a GPU where torch has one (auto)")
    add_number(parser, "--threads", bounds.THREADS, help="threads of the CPU (all cores)")
    add_number(parser, "--checkpoint-minutes", bounds.CHECKPOINT_MINUTES, default=5.0, help="time between checkpoints")
    parser.add_argument("--evaluate", action="store_true", help="run the evaluations that are printed at the end")
    add_number(
        parser, "--every", bounds.TRACK_FRAMES, default=_EVERY, help=f"frames of a track that they look at ({_EVERY})"
    )
    add_out(parser, "folder for octrees, samples, networks and tables", required=True)


def run(args: argparse.Namespace) -> int:
    """Train what is missing, write the tables, print or run what comes next; returns 0; raises PatchNetError."""
    from ...patchnet_addon.runtime.outputs import check_outputs
    from ...training.evaluation.catalogue import scene_octree
    from ...training.networks_of_paper.plan import OUTPUTS, octrees_folder
    from ..shared.progress_bars import ProgressBars

    check_octrees(args.octrees)
    scenes = _scenes(args)
    names = [*(scene.name for scene in scenes), *(path.stem for path in args.octrees)]
    plans = planned_networks(names, _words(args.kinds), args.unseen)
    if not plans:
        raise SettingError("There is nothing to train: name --kinds of networks")
    check_outputs({args.out / name: kind for name, kind in OUTPUTS.items()}, args.octrees, folder=args.out)
    require_torch()
    from ...training.networks_of_paper.run import train_networks, write_tables

    work = _work(args)
    args.out.mkdir(parents=True, exist_ok=True)
    with ProgressBars() as bars:
        octrees = {scene.name: scene_octree(scene, octrees_folder(args.out)) for scene in scenes}
        octrees |= {path.stem: path for path in args.octrees}
        rows = drain(train_networks(octrees, plans, work), bars.show)
    write_tables(
        args.out,
        {"samples": args.samples, "least_level": args.least_level, "voxels": args.voxels} | asdict(work.settings),
        rows,
    )
    say_result(f"{args.out}: {counted(len(rows), 'network')}", file=args.out, networks=len(rows))
    for words in next_commands(args.out, octrees, plans, [scene.name for scene in scenes], args.every):
        print(shlex.join(["patchnet", *words]))
        if args.evaluate and (code := main(words)):
            return code
    return 0


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _scenes(args: argparse.Namespace) -> list[Scene]:
    """Scenes of the catalogue that are named; raises SettingError where there is neither a scene nor an octree."""

    if not args.scenes and not args.octrees:
        raise SettingError("There is nothing to learn from: name --scenes, or octree files")
    return scenes_named(args.scenes) if args.scenes else []


def _work(args: argparse.Namespace) -> NetworksRun:
    """Budget and settings of the run; raises SettingError for a device that is not there."""
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


def next_commands(
    out: Path, octrees: Mapping[str, Path], plans: Sequence[NetworkPlan], catalogue: Sequence[str], every: int
) -> list[list[str]]:
    """Words of the commands that evaluate the networks: the matrix, the encoders on the unseen scene, the figure.

    octrees: files by name of the scene. catalogue: names of those that are scenes of the catalogue. The figure of
    look-aheads is of one of them, so it is drawn where there are any.
    """
    from ...training.networks_of_paper.plan import octrees_folder, weights_path

    def named(some: Sequence[NetworkPlan]) -> list[str]:
        return [f"{plan.name}={weights_path(out, plan.name)}" for plan in some]

    others = [plan for plan in plans if not plan.is_of_evaluation]
    usual = [plan for plan in plans if plan.is_of_evaluation]
    files = [str(path) for name, path in octrees.items() if name not in catalogue]
    scenes = ["--scenes", ",".join(catalogue)] if catalogue else []
    words = ["lab", "evaluate", *files, *scenes, "--every", str(every), "--networks", *named(usual)]
    found = [[*words, "--out", str(out)]]
    compared = [plan for plan in usual if others and plan.name == others[0].compared]
    if encoders := [plan for plan in others if plan.encoder != MLP.name]:
        unseen = next(path for name, path in octrees.items() if name not in encoders[0].scenes)
        words = ["lab", "evaluate", str(unseen), "--every", str(every), "--networks", *named([*compared, *encoders])]
        found.append([*words, "--out", str(out / "encoders")])
    if catalogue and (ahead := [plan for plan in others if plan.encoder == MLP.name]):
        words = ["lab", "figures", "--only", "look-ahead", "--octrees", str(octrees_folder(out))]
        found.append([*words, "--networks", *named([*compared, *ahead]), "--out", str(out / "look-ahead")])
    return found
