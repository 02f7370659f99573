# SPDX-License-Identifier: GPL-3.0-or-later
"""Model card of a training run: data, code, command, seed, curves, validation errors; Markdown and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...patchnet_addon.network.encoders import EncoderKind, patch_side
from ..benchmarks.tables import markdown_table
from ..data.dataset import Dataset
from ..data.held_out import is_turned, scene_of
from ..encoders import ConvolvingKind
from ..settings import VALIDATION_VOXELS, TrainSettings
from .run_files import CARD, CURVES, LOG, log_lines

_DATA_COLUMNS = ("data set", "scene", "depth", "light", "turned", "use", "samples", "held-out parts", "octree hash")
_ERROR_COLUMNS = (
    "data set", "coverage", "best constant", "luminance", "as the voxel shows it", "best constant"
)  # fmt: skip
_NOT_RECORDED = "not recorded"


def read_log(path: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Lines of the training curve and of the validations in a log."""
    lines = log_lines(path)
    return [line for line in lines if "coverage" in line], [line for line in lines if "validation" in line]


def write_card(
    folder: Path,
    datasets: Sequence[Dataset],
    settings: TrainSettings,
    notes: dict[str, Any],
    weights_hash: str,
    validation: Sequence[Dataset] = (),
) -> None:
    """Write `model_card.md`, and `curves.png` where matplotlib is installed, beside the log in `folder`.

    notes: metadata of the weights. validation: data sets that were not learned from.
    """
    curve, validations = read_log(folder / LOG)
    lookahead = datasets[0].lookahead
    side = patch_side(lookahead)
    kind = settings.kind
    encoder = encoder_text(settings.encoder_kind, lookahead)
    decoder = "-".join(map(str, kind.decoder))
    has_picture = draw_curves(curve, validations, folder / CURVES)
    parts = [
        "# Model card of PatchNet weights\n",
        f"Weights `{weights_hash}` of the network `{kind.name}`. Encoder {encoder}, decoder {decoder}, look-ahead of "
        f"{_levels(lookahead)}.\n",
        f"Input: occupancy, linear luminance in [0, 1] and mean normal of {side}x{side}x{side} fine voxels around each",
        "corner of a voxel. Output: coverage and luminance that a pixel of half to a whole voxel would see.\n",
        "## How they were made\n",
        f"    {notes['command']}\n",
        f"{notes['sample_passes']:,} sample passes in {notes['steps']:,} steps, {notes['minutes']:.0f} minutes on"
        f" {notes['machine']}; versions {notes['versions']}.{_extension(notes)}\n",
        f"Hash of the code: {_quoted(notes.get('code'))}; commit: {_quoted(notes.get('commit'))}.\n",
        *_table(["setting", "value"], [[name, str(value)] for name, value in asdict(settings).items()]),
        "## Data\n",
        *_data_summary(datasets),
        *_table(
            list(_DATA_COLUMNS),
            [_data_row(dataset, "training", notes.get("octrees", {})) for dataset in datasets]
            + [_data_row(dataset, "validation", notes.get("validation_octrees", {})) for dataset in validation],
        ),
        *_errors(validations[-1] if validations else {}),
        "## Curves\n",
        "![Training and validation errors](curves.png)\n" if has_picture else "The numbers stand in `log.jsonl`.\n",
        "## Limits\n",
        f"Trained on voxels with {_levels(lookahead)} of look-ahead and pixels of half to a whole voxel. Only",
        "view-independent luminance is known; scenes unlike those above can be predicted worse.\n",
    ]
    (folder / CARD).write_text("\n".join(parts))


def encoder_text(kind: EncoderKind, lookahead: int) -> str:
    """Layers of an encoder in words: the sizes of `mlp`, or an architecture with its number of parameters."""
    if not isinstance(kind, ConvolvingKind):
        return "-".join(map(str, kind.sizes(lookahead)))
    return f"{kind.name} ({kind.text}; {kind.parameters(lookahead):,} parameters)"


def _levels(lookahead: int) -> str:
    return {1: "one level", 2: "two levels", 3: "three levels"}[lookahead]


def draw_curves(curve: list[dict[str, Any]], validations: list[dict[str, Any]], path: Path) -> bool:
    """Draw training and validation errors over sample passes; False where matplotlib is not installed."""
    try:
        from matplotlib import colormaps
        from matplotlib.figure import Figure
    except ImportError:
        return False
    figure = Figure(figsize=(10.5, 4), layout="constrained")
    for axes, field in zip(figure.subplots(1, 2), ("coverage", "luminance"), strict=True):
        axes.set_prop_cycle(color=colormaps["tab20"](range(20)))
        axes.plot([line["passes"] / 1e6 for line in curve], [line[field] for line in curve], "0.6", label="training")
        for name in validations[-1]["validation"] if validations else ():
            here = [line for line in validations if name in line["validation"]]
            points = [(line["passes"] / 1e6, line["validation"][name][field]) for line in here]
            axes.plot(*zip(*points, strict=True), ".-", label=name)
        axes.set(xlabel="million sample passes", ylabel=f"mean absolute error of {field}", yscale="log")
        axes.grid(alpha=0.3, which="both")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize="x-small")
    figure.savefig(path, dpi=110)
    return True


def _extension(notes: dict[str, Any]) -> str:
    """Sentence on a run that got more passes after its end."""
    ends = [f"{passes:,}" for passes in notes.get("extended_from", ())]
    return f" It was a run of {' and then '.join(ends)} passes first, and went on from there." if ends else ""


def _quoted(value: str | None) -> str:
    return f"`{value}`" if value else _NOT_RECORDED


def _data_summary(datasets: Sequence[Dataset]) -> list[str]:
    """Sentence on how many samples there are and are learned from."""
    views = datasets[0].samples.views.shape[1]
    if datasets[0].is_fresh:
        return [
            f"Each step drew new voxels of {views} views from the octrees, apart from the held-out parts, which were",
            "not learned from.\n",
        ]
    voxels = sum(len(dataset.samples.voxel) for dataset in datasets)
    held = sum(int(dataset.samples.held_out.sum()) for dataset in datasets)
    return [
        f"{voxels * views:,} samples, {voxels:,} voxels of {views} views; {held * views:,} of them are of held-out",
        f"parts and were not learned from, the other {(voxels - held) * views:,} again and again.\n",
    ]


def _data_row(dataset: Dataset, use: str, hashes: dict[str, str]) -> list[str]:
    samples = dataset.samples
    views = samples.views.shape[1]
    held = int(samples.held_out.sum()) * views
    counts = ["drawn by each step", "not learned from"] if dataset.is_fresh else [
        f"{len(samples.voxel) * views:,}", f"{held:,}"
    ]  # fmt: skip
    light = str(dataset.octree.provenance.get("light", ""))
    turned = "yes" if is_turned(dataset) else "no"
    octree = _quoted(hashes.get(dataset.name))
    return [dataset.name, scene_of(dataset), str(dataset.octree.depth), light, turned, use, *counts, octree]


def _errors(last: dict[str, Any]) -> list[str]:
    """Errors of the last validation, those on held-out scenes apart from those on scenes that training holds."""
    errors, why = last.get("validation", {}), last.get("not_held_out", {})
    unseen = [[name, *_error_row(errors[name])] for name in errors if name not in why]
    known = [[name, *_error_row(errors[name]), why[name]] for name in errors if name in why]
    nothing = [
        "No scene was held out: `patchnet lab train --validate` takes sample files of scenes that are not learned "
        "from.\n"
    ]
    lines = [
        "## Errors on held-out scenes\n",
        "Mean absolute errors on scenes that are not in training in any pose, beside those of guesses that need no",
        "network: the best constant, and luminance as the voxel shows it.\n",
        *(_table(list(_ERROR_COLUMNS), unseen) if unseen else nothing),
    ]
    if known:
        lines += [
            "## Errors on scenes that are in training\n",
            "The same errors on voxels that were not learned from, of scenes that were: they are optimistic.\n",
            *_table([*_ERROR_COLUMNS, "why not held out"], known),
        ]
    return (
        [*lines, f"Errors are those of at most {VALIDATION_VOXELS:,} voxels of each data set.\n"] if errors else lines
    )


def _error_row(entry: dict[str, float]) -> list[str]:
    fields = ("coverage", "constant_coverage", "luminance", "voxel_luminance", "constant_luminance")
    return [f"{entry[field]:.4f}" for field in fields]


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    return [markdown_table(head, rows), ""]
