# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train-networks`: train the networks of the paper on scenes, each on the same budget.

    patchnet lab train-networks --scenes shuttle,sponza,station,san-miguel-bare --samples 2000000 --passes 16000000 --out out/networks

Kinds of networks:

    scene       trained on one scene, with its name
    without     trained on all scenes but one, without-SCENE
    look-ahead  look-ahead-1 and look-ahead-3, trained on all scenes but --unseen
    encoders    conv3d and voxception, trained on all scenes but --unseen; they need torch for encoding

Creates missing octrees of the catalogue's scenes and missing samples, and trains the networks with checkpoints; a later
run goes on where one stopped. Prints, and writes into errors.json, the errors of each network on its held-out scenes.
"""  # noqa: E501  a command stands on one line

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....commands.shared.arguments import add_device, add_number, add_out
from ....commands.shared.lines import say_result
from ....patchnet_addon.network.encoders import MLP
from ....patchnet_addon.network.kinds import KINDS as NETWORK_KINDS
from ....patchnet_addon.runtime import bounds
from ....patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD, LOOKAHEADS
from ....patchnet_addon.runtime.errors import SettingError
from ....patchnet_addon.runtime.progress import Steps, drain, labelled
from ....patchnet_addon.runtime.quantities import counted
from ... import bounds as lab_bounds
from ...benchmarks import markdown_table
from ...encoders import ENCODERS
from ...evaluation import WITHOUT
from ...run.run_files import CHECKPOINT
from ...settings import LOSSES, PRESETS, preset_with
from ..arguments import check_octrees
from ..training_run import require_torch
from .scene_arguments import add_scenes, scenes_named

if TYPE_CHECKING:
    from ...data.dataset import Dataset

TABLE = "errors.json"
SCENE, WITHOUT_ONE, LOOK_AHEAD, ENCODER = KINDS = ("scene", "without", "look-ahead", "encoders")
_SAMPLES, _PASSES, _VOXELS = 2_000_000, 16_000_000, 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("octrees", nargs="*", type=Path, metavar="OCTREE", help="octree files beside --scenes")
    add_scenes(parser)
    parser.add_argument(
        "--kinds", default=",".join(KINDS), metavar="KIND,KIND", help=f"kinds of networks ({','.join(KINDS)})"
    )
    parser.add_argument("--unseen", metavar="NAME", help="held-out scene of look-ahead and encoders (the last one)")
    add_number(parser, "--samples", lab_bounds.DATASET_SAMPLES, "samples of each scene", _SAMPLES)
    add_number(parser, "--least-level", bounds.LEVEL, "coarsest level of voxels", 5)
    add_number(parser, "--passes", lab_bounds.PASSES, "passes of each network", _PASSES)
    parser.add_argument("--preset", choices=tuple(PRESETS), default="improved", help="preset of settings (improved)")
    parser.add_argument("--network", choices=tuple(NETWORK_KINDS), help="kind of network; paper, with --loss absolute")
    parser.add_argument("--loss", choices=LOSSES, help="error to minimize")
    add_number(parser, "--seed", bounds.SEED, "random seed of samples and trainings", 0)
    add_number(parser, "--voxels", lab_bounds.DATASET_SAMPLES, "voxels of a scene for errors", _VOXELS)
    add_device(parser, "device for training; auto: a GPU if torch has one (auto)")
    add_number(parser, "--threads", lab_bounds.THREADS, "threads of the CPU (all cores)")
    add_out(parser, "folder for octrees, samples and networks", required=True)


def run(args: argparse.Namespace) -> int:
    """Train the networks, print their errors and write them; returns 0; raises PatchNetError."""
    from ....commands.shared.progress_lines import progress_lines
    from ....patchnet_addon.network.devices import found_device
    from ....patchnet_addon.runtime.outputs import check_outputs
    from ...evaluation.catalogue import scene_octree
    from ...file_kinds import ERRORS
    from .validate import errors_of, write_errors

    if not args.scenes and not args.octrees:
        raise SettingError("There is nothing to train on: name --scenes, or octree files")
    check_octrees(args.octrees)
    scenes = scenes_named(args.scenes) if args.scenes else []
    names = [*(scene.name for scene in scenes), *(path.stem for path in args.octrees)]
    plans = planned_networks(names, [word.strip() for word in args.kinds.split(",") if word.strip()], args.unseen)
    if not plans:
        raise SettingError("There is nothing to train: name --kinds of networks")
    check_outputs({args.out / TABLE: ERRORS}, args.octrees, folder=args.out)
    require_torch()
    from ...run.provenance import run_notes
    from ...run.trainer import RunOptions, train

    args.device = found_device(args.device, "--device")
    changes = {"passes": args.passes, "seed": args.seed, "network": args.network, "loss": args.loss}
    settings = preset_with(args.preset, changes)
    octrees = {scene.name: scene_octree(scene, args.out / "octrees") for scene in scenes}
    octrees |= {path.stem: path for path in args.octrees}
    data: dict[int, dict[str, Dataset]] = {}
    found = {}
    show = progress_lines()
    for lookahead in {plan.lookahead: None for plan in plans}:
        data[lookahead] = drain(_samples(args, octrees, lookahead), show)
    for number, plan in enumerate(plans, 1):
        folder, sets = args.out / "networks" / plan.name, data[plan.lookahead]
        own = replace(settings, encoder=plan.encoder, encoder_width=0)
        options = RunOptions(folder, (folder / CHECKPOINT).exists())
        options.device, options.threads = args.device, args.threads
        options.notes = run_notes(args.device) | {"settings": asdict(own)}
        steps = train([sets[scene] for scene in plan.scenes], own, options)
        weights = drain(labelled(steps, f"Training {plan.name} ({number} of {len(plans)})"), show)
        unseen = [each for scene, each in sets.items() if scene not in plan.scenes]
        found[plan.name] = errors_of(weights, unseen, args.voxels)
    rows = [[name, *(_cell(each["scenes"].get(scene)) for scene in names)] for name, each in found.items()]
    print(f"Errors of coverage (of luminance, over the voxel's own):\n{markdown_table(['network', *names], rows)}")
    write_errors(args.out / TABLE, found)
    say_result(f"{args.out}: {counted(len(plans), 'network')}", file=args.out, networks=len(plans))
    return 0


def _samples(args: argparse.Namespace, octrees: Mapping[str, Path], lookahead: int) -> Steps[dict[str, Dataset]]:
    """Samples by scene; missing files are drawn. Raises SettingError for a file of other arguments."""
    from ...data.dataset import DATASET_SEEDS, SUFFIX, draw_dataset, load_dataset
    from ...data.voxel_choice import SampleSettings

    folder, found = args.out / "samples" / f"look-ahead-{lookahead}", {}
    folder.mkdir(parents=True, exist_ok=True)
    for number, (scene, octree) in enumerate(octrees.items()):
        seed = args.seed + DATASET_SEEDS * number
        settings = SampleSettings(min_level=args.least_level, seed=seed, lookahead=lookahead)
        path = folder / (scene + SUFFIX)
        if not path.exists():
            yield from draw_dataset(octree, args.samples, settings, path)
        found[scene] = load_dataset(path)
        more = found[scene].samples.views[..., 0].size - args.samples
        if found[scene].sample_settings != settings or not 0 <= more < settings.views:
            raise SettingError(f"{path} was drawn with other arguments: delete it, or choose another folder")
    return found


def _cell(errors: Mapping[str, Any] | None) -> str:
    if errors is None:
        return "seen"
    ratio = errors["luminance_ratio"]
    return f"{errors['coverage']:.3f} ({'' if ratio is None else f'{ratio:.2f}'})"


@dataclass(frozen=True)
class NetworkPlan:
    """Network to train, with the names of its training scenes and of its encoder."""

    name: str
    scenes: tuple[str, ...]
    encoder: str = MLP.name
    lookahead: int = DEFAULT_LOOKAHEAD


def planned_networks(scenes: Sequence[str], kinds: Sequence[str], unseen: str | None = None) -> list[NetworkPlan]:
    """Networks of these kinds for scenes, in the order of training, without duplicates.

    kinds: "scene": one of each scene alone, named after it. "without": one of all but each scene, without-SCENE.
    "look-ahead": look-ahead-1 and look-ahead-3, "encoders": one named after each other encoder; both are trained on all
    scenes but `unseen` (the last one), and include without-UNSEEN for comparison. Raises SettingError for an unknown
    kind or scene, duplicate scenes, and without a scene to hold out.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise SettingError(f"Unknown kind of networks '{kind}': choose from {', '.join(KINDS)}")
    twice = [scene for scene in scenes if list(scenes).count(scene) > 1]
    if twice:
        raise SettingError(f"Scene {twice[0]!r} is named twice: name each scene once")
    if set(kinds) - {SCENE} and len(scenes) < 2:
        raise SettingError("A single scene has no held-out scene: name two scenes at least")
    if unseen is not None and unseen not in scenes:
        raise SettingError(f"Scene {unseen!r} is not among the scenes: hold out one of {', '.join(scenes)}")
    plans = [NetworkPlan(scene, (scene,)) for scene in scenes if SCENE in kinds]
    plans += [_without(scene, scenes) for scene in scenes if WITHOUT_ONE in kinds]
    if LOOK_AHEAD in kinds or ENCODER in kinds:
        usual = _without(unseen or scenes[-1], scenes)
        plans += [] if usual in plans else [usual]
        others = [lookahead for lookahead in LOOKAHEADS if lookahead != usual.lookahead and LOOK_AHEAD in kinds]
        for each in others:
            plans.append(NetworkPlan(f"look-ahead-{each}", usual.scenes, lookahead=each))
        for name in [name for name in ENCODERS if name != MLP.name and ENCODER in kinds]:
            plans.append(NetworkPlan(name, usual.scenes, name))
    _check_names(plans)
    return plans


def _without(scene: str, scenes: Sequence[str]) -> NetworkPlan:
    return NetworkPlan(WITHOUT + scene, tuple(other for other in scenes if other != scene))


def _check_names(plans: Sequence[NetworkPlan]) -> None:
    names = [plan.name for plan in plans]
    for name in names:
        if names.count(name) > 1:
            raise SettingError(f"Two networks would be called {name!r}: rename the octree file of that scene")
