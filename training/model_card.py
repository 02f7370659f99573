# SPDX-License-Identifier: GPL-3.0-or-later
"""Model card of a training run: data, command, seed, curves, validation errors; Markdown and a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..patchnet_addon.network.weights import DECODER_SIZES, encoder_sizes, patch_side
from .dataset import Dataset
from .run_files import CARD, CURVES, LOG
from .settings import TrainSettings

_DATA_COLUMNS = ("data set", "scene", "depth", "light", "turned", "samples", "held out")


def read_log(path: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Lines of the training curve and of the validations in a log."""
    lines = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    return [line for line in lines if "coverage" in line], [line for line in lines if "validation" in line]


def write_card(
    folder: Path, datasets: Sequence[Dataset], settings: TrainSettings, notes: dict[str, Any], weights_hash: str
) -> None:
    """Write `model_card.md`, and `curves.png` where matplotlib is installed, beside the log in `folder`."""
    curve, validations = read_log(folder / LOG)
    lookahead = datasets[0].lookahead
    side = patch_side(lookahead)
    encoder, decoder = ("-".join(map(str, sizes)) for sizes in (encoder_sizes(lookahead), DECODER_SIZES))
    has_picture = draw_curves(curve, validations, folder / CURVES)
    parts = [
        "# Model card of PatchNet weights\n",
        f"Weights `{weights_hash}`. Encoder {encoder}, decoder {decoder}, look-ahead of {_levels(lookahead)}.\n",
        f"Input: occupancy, linear luminance in [0, 1] and mean normal of {side}x{side}x{side} fine voxels around each",
        "corner of a voxel. Output: coverage and luminance that a pixel of half to a whole voxel would see.\n",
        "## How they were made\n",
        f"    {notes['command']}\n",
        f"{notes['sample_passes']:,} sample passes in {notes['steps']:,} steps, {notes['minutes']:.0f} minutes on"
        f" {notes['machine']}; versions {notes['versions']}.\n",
        *_table(["setting", "value"], [[name, str(value)] for name, value in asdict(settings).items()]),
        "## Data\n",
        *_table(list(_DATA_COLUMNS), [_data_row(dataset) for dataset in datasets]),
        "## Errors on held-out parts of the scenes\n",
        "Mean absolute errors; those of the best constant guess in brackets. Where a scene is there upright and",
        "turned, parts held out in one pose are seen in the other, so these errors are optimistic; a scene that took",
        "no part in training, such as the demo scene, is the honest test.\n",
        *_validation_table(validations),
        "## Curves\n",
        "![Training and validation errors](curves.png)\n" if has_picture else "The numbers stand in `log.jsonl`.\n",
        "## Limits\n",
        f"Trained on voxels with {_levels(lookahead)} of look-ahead and pixels of half to a whole voxel. Only",
        "view-independent luminance is known; scenes unlike those above can be predicted worse.\n",
    ]
    (folder / CARD).write_text("\n".join(parts))


def _levels(lookahead: int) -> str:
    return {1: "one level", 2: "two levels", 3: "three levels"}[lookahead]


def draw_curves(curve: list[dict[str, Any]], validations: list[dict[str, Any]], path: Path) -> bool:
    """Draw training and validation errors over sample passes; False where matplotlib is not installed."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return False
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, field in zip(figure.subplots(1, 2), ("coverage", "luminance"), strict=True):
        axes.plot([line["passes"] / 1e6 for line in curve], [line[field] for line in curve], "0.6", label="training")
        for name in validations[-1]["validation"] if validations else ():
            points = [(line["passes"] / 1e6, line["validation"][name][field]) for line in validations]
            axes.plot(*zip(*points, strict=True), ".-", label=name)
        axes.set(xlabel="million sample passes", ylabel=f"mean absolute error of {field}", yscale="log")
        axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize="x-small")
    figure.savefig(path, dpi=110)
    return True


def _data_row(dataset: Dataset) -> list[str]:
    samples = dataset.samples
    views = samples.views.shape[1]
    made = dataset.octree.provenance
    scene = Path(str(made.get("file", made.get("scene", "")))).name
    held = int(samples.held_out.sum()) * views
    turned = "yes" if made.get("rotation") else "no"
    counts = [f"{len(samples.voxel) * views:,}", f"{held:,}"]
    return [dataset.name, scene, str(dataset.octree.depth), str(made.get("light", "")), turned, *counts]


def _validation_table(validations: list[dict[str, Any]]) -> list[str]:
    if not validations:
        return ["None was run.\n"]
    rows = [
        [name, *(f"{entry[field]:.4f} ({entry['constant_' + field]:.3f})" for field in ("coverage", "luminance"))]
        for name, entry in validations[-1]["validation"].items()
    ]
    return _table(["data set", "coverage", "luminance"], rows)


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(line) + " |" for line in lines] + [""]
