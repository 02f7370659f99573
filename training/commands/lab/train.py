# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab train`: train PatchNet on sample files."""

from __future__ import annotations

import argparse
from dataclasses import asdict, fields
from pathlib import Path

from ....commands.shared.arguments import add_number, add_out
from ....commands.shared.lines import say_note, say_result
from ....patchnet_addon.network.encoders import MLP, MLP_WIDTH_STEP
from ....patchnet_addon.network.kinds import KINDS, MIXTURE, WIDTH_STEP
from ....patchnet_addon.runtime import bounds
from ....patchnet_addon.runtime.progress import drain
from ... import bounds as lab_bounds
from ...encoders import ENCODERS
from ...run.run_files import LOG, RUN_FILES, WEIGHTS, check_run, read_log
from ...settings import (
    LOSSES,
    PRECISIONS,
    PRESETS,
    SAMPLES,
    SCHEDULES,
    SHIPPED_PASSES,
    SHIPPED_WIDTH,
    VIEWS,
    TrainSettings,
    preset_with,
)
from ..training_run import add_run_arguments, require_torch, say_written

_PRESET = "improved"


def description() -> str:
    """Description of the command with the numbers of the shipped weights."""
    return f"""Train PatchNet on sample files.

A pass is one sample seen once. Samples are those of files, gone through again and again:

    patchnet lab dataset OCTREE... --samples {SAMPLES} --out samples
    patchnet lab train samples --preset {_PRESET} --out run

With --fresh the arguments are octrees, and each step draws voxels anew, of {VIEWS} views each. So the
shipped weights learned in {SHIPPED_PASSES:,} passes (training/shipped_weights.sh):

    patchnet lab train OCTREE... --fresh --preset {_PRESET} --encoder-width {SHIPPED_WIDTH} \\
        --passes {SHIPPED_PASSES} --out run

Errors of an unseen scene are those of --validate, of scenes that are not in training in any pose. Parts that `dataset`
held out of scenes in training are validated on too, and reported apart."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.description = description()
    parser.add_argument(
        "datasets", nargs="+", type=Path, metavar="DATASET",
        help="sample files, or folders of them; with --fresh octree files",
    )  # fmt: skip
    parser.add_argument(
        "--fresh", action="store_true",
        help="draw new voxels and views from octrees at every step instead of reading sample files",
    )  # fmt: skip
    add_out(parser, "folder for checkpoint, log and weights", required=True)
    parser.add_argument(
        "--validate", nargs="+", type=Path, default=[], metavar="DATASET",
        help="sample files of held-out scenes, or folders of them, for validation",
    )  # fmt: skip
    passes = ", ".join(f"{name} {settings.passes:,}" for name, settings in PRESETS.items())
    text = f"default of the other options ({_PRESET}); passes: {passes}"
    parser.add_argument("--preset", choices=tuple(PRESETS), default=_PRESET, help=text)
    add_number(parser, "--passes", lab_bounds.PASSES, "sample passes in all")
    add_number(parser, "--batch", lab_bounds.BATCH, "samples per step")
    add_number(
        parser, "--rate", lab_bounds.LEARNING_RATE, "highest learning rate", dest="learning_rate", metavar="RATE"
    )
    parser.add_argument("--network", choices=tuple(KINDS), help="kind of network: paper, or mixture")
    text = f"values between the layers of a mixture's decoder, a multiple of {WIDTH_STEP} ({MIXTURE.width})"
    add_number(parser, "--decoder-width", bounds.DECODER_WIDTH, text)
    parser.add_argument(
        "--encoder", choices=tuple(ENCODERS), help="architecture of the encoder: the paper's linear layers (mlp), 3D "
        "convolutions, or Voxception blocks, which research commands alone run",
    )  # fmt: skip
    add_number(
        parser, "--encoder-width", bounds.ENCODER_WIDTH, "values between the layers of the encoder mlp, a multiple of "
        f"{MLP_WIDTH_STEP} ({MLP.width}): costs time when codes are made, none when pixels are decoded",
    )  # fmt: skip
    parser.add_argument("--loss", choices=LOSSES, help="error to minimize; squared errors are minimal for means")
    parser.add_argument("--schedule", choices=SCHEDULES, help="schedule of the learning rate")
    add_number(parser, "--luminance-weight", lab_bounds.LUMINANCE_WEIGHT, "factor of the luminance error in the loss")
    parser.add_argument(
        "--precision", choices=PRECISIONS, help="of the encoder's matrix products; tf32: of all, on a GPU"
    )
    add_number(parser, "--seed", bounds.SEED, "random seed")
    add_run_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Train and write the weights."""
    from ...data.dataset import sample_files

    files = args.datasets if args.fresh else sample_files(args.datasets)
    validation_files = sample_files(args.validate)
    check_run(args.out, [*files, *validation_files], resume=args.resume)
    require_torch()
    from ....commands.shared.progress_lines import progress_lines
    from ....patchnet_addon.network.devices import found_device
    from ...data.dataset import fresh_datasets, load_dataset, why_not_held_out
    from ...run.provenance import run_notes
    from ...run.trainer import RunOptions, train

    device = found_device(args.device, "--device")
    datasets = fresh_datasets(files, args.seed or 0) if args.fresh else [load_dataset(path) for path in files]
    validation = [load_dataset(path) for path in validation_files]
    for dataset in validation:
        if reason := why_not_held_out(dataset, datasets):
            say_note(f"{dataset.name} is {reason}")
    settings = preset_with(args.preset, {each.name: getattr(args, each.name, None) for each in fields(TrainSettings)})
    options = RunOptions(args.out, args.resume, stop_after=args.stop_after)
    options.device, options.threads, options.validation = device, args.threads, validation
    options.notes = run_notes(device) | {"settings": asdict(settings)}
    weights = drain(train(datasets, settings, options), progress_lines())
    path = args.out / WEIGHTS
    curve, validations = read_log(args.out / LOG)
    found = {"learned from": curve[-1]} | (validations[-1]["validation"] if validations else {})
    print("Mean absolute errors of coverage, of luminance, and of luminance as the voxel shows it:")
    for name, errors in found.items():
        figures = [f"{errors[key]:.4f}" for key in ("coverage", "luminance", "voxel_luminance") if key in errors]
        print(f"  {name:<24} {' '.join(figures)}")
    say_written(args.out, RUN_FILES)
    say_result(f"{path}: {weights.metadata['sample_passes']:,} sample passes", file=path)
    return 0
