# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab validate`: errors of weights on samples of scenes, beside those of the voxel's own luminance.

    patchnet lab dataset unseen/*.safetensors --samples 200000 --out unseen-samples
    patchnet lab validate unseen-samples --weights new.safetensors --out errors.json

The default is the shipped weights. The scenes should be held out from training in any pose.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ....commands.shared.arguments import add_number, add_out
from ....patchnet_addon.runtime.quantities import counted
from ... import bounds
from ..training_run import require_torch

_VOXELS = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("datasets", nargs="+", type=Path, metavar="DATASET", help="sample files, or folders of them")
    parser.add_argument("--weights", nargs="+", type=Path, default=[], metavar="FILE", help="weights files")
    add_number(parser, "--voxels", bounds.DATASET_SAMPLES, "voxels of each file at most", _VOXELS)
    add_out(parser, "JSON file for all errors")


def run(args: argparse.Namespace) -> int:
    """Print a line of errors for each of the weights and files; returns 0; raises PatchNetError."""
    from ....commands.shared.lines import make_parent, say_result
    from ....patchnet_addon.runtime.outputs import check_outputs
    from ....patchnet_addon.runtime.replace import replaced_file
    from ...data.dataset import check_names, load_dataset, name_of, sample_files
    from ...encoders import load_weights
    from ...file_kinds import ERRORS

    require_torch()
    from ...run.validation import weights_errors

    files = sample_files(args.datasets)
    check_names(name_of(file) for file in files)
    if args.out:
        check_outputs({args.out: ERRORS}, [*files, *args.weights])
        make_parent(args.out)
    found: dict[str, Any] = {}
    for path in args.weights or [None]:
        weights = load_weights(path)
        name = str(path) if path else "shipped"
        print(f"{name} ({weights.hash})")
        datasets = map(load_dataset, files)
        scenes = {dataset.name: weights_errors(weights, dataset, args.voxels) for dataset in datasets}
        found[name] = {"weights_hash": weights.hash, "scenes": scenes}
        for scene, errors in scenes.items():
            print(f"  {scene:<24} {_line(errors)}")
    if args.out:
        with replaced_file(args.out, ERRORS) as target:
            target.write(json.dumps({"errors": found}, indent=1).encode())
    say_result(f"{counted(len(files), 'file')}, {len(found)} weights", file=args.out)
    return 0


def _line(errors: dict[str, Any]) -> str:
    of_luminance = "the voxel's own errs by nothing"
    if errors["luminance_ratio"] is not None:
        ratio, squared = errors["luminance_ratio"], errors["luminance_squared_ratio"]
        of_luminance = f"{ratio:.2f} of the voxel's own, squared {squared:.2f}"
    return f"coverage {errors['coverage']:.4f}, luminance {errors['luminance']:.4f}: {of_luminance}"
