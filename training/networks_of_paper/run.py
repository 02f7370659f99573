# SPDX-License-Identifier: GPL-3.0-or-later
"""Train the networks of a plan one after the other, and measure them on held-out scenes.

A later run skips finished networks, and resumes an interrupted one from its checkpoint.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...patchnet_addon.network.weights import Weights, save_weights
from ...patchnet_addon.octree.file import load_octree, octree_hash
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import FileFormatError, WeightsFileError
from ...patchnet_addon.runtime.file_kinds import NETWORK_RECORD, NETWORKS
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.runtime.replace import replaced_file
from ..data.dataset import DATASET_SEEDS, SUFFIX, Dataset, load_dataset, save_samples
from ..data.samples import SampleSettings, draw_samples
from ..encoders import ENCODERS, load_weights
from ..run.run_files import CHECKPOINT, LOG, read_log
from ..run.trainer import RunOptions, train
from ..run.validation import weights_errors
from ..settings import TrainSettings
from .plan import RECORD, VALUES, NetworkPlan, network_folder, weights_path


@dataclass(frozen=True)
class NetworksRun:
    """Budget of each network of a run, and options.

    samples: of each scene. least_level: coarsest level of their voxels. settings: of training, with the passes of each
    network. voxels: most voxels of each scene for errors. options: of training; its folder is that of all networks.
    """

    samples: int
    least_level: int
    settings: TrainSettings
    voxels: int
    options: RunOptions

    @property
    def out(self) -> Path:
        """Folder of the run."""
        return self.options.out


def train_networks(
    octrees: Mapping[str, Path], plans: Sequence[NetworkPlan], run: NetworksRun
) -> Steps[list[dict[str, Any]]]:
    """Train the networks on octree files by name of the scene; returns a row of plain JSON values for each.

    Raises PatchNetError for octrees without samples, and for a network that was started with other settings.
    """
    data: dict[int, dict[str, Dataset]] = {}
    for lookahead in dict.fromkeys(plan.lookahead for plan in plans):
        data[lookahead] = yield from _samples(octrees, lookahead, run)
    rows = []
    for number, plan in enumerate(plans, 1):
        row = yield from _network(plan, data[plan.lookahead], run, f"{plan.name} ({number} of {len(plans)})")
        rows.append(row)
    return rows


def _samples(octrees: Mapping[str, Path], lookahead: int, run: NetworksRun) -> Steps[dict[str, Dataset]]:
    found = {}
    for number, (scene, octree) in enumerate(octrees.items()):
        settings = SampleSettings(
            min_level=run.least_level, seed=run.settings.seed + DATASET_SEEDS * number, lookahead=lookahead
        )
        path = samples_path(run.out, scene, lookahead)
        found[scene] = yield from scene_samples(octree, path, run.samples, settings)
    return found


def _network(plan: NetworkPlan, data: Mapping[str, Dataset], run: NetworksRun, title: str) -> Steps[dict[str, Any]]:
    """Row of a network; trains it unless there is a record with these settings."""
    folder = network_folder(run.out, plan.name)
    settings = settings_of(plan, run.settings)
    key = _key(plan, data, run, settings)
    if (kept := _kept_row(folder / RECORD, key, weights_path(run.out, plan.name))) is not None:
        return kept
    learned = [data[scene] for scene in plan.scenes]
    notes = run.options.notes | {"settings": asdict(settings)}
    options = replace(run.options, out=folder, resume=(folder / CHECKPOINT).exists(), notes=notes)
    weights = yield from labelled(train(learned, settings, options), f"Training {title}")
    save_weights(weights, weights_path(run.out, plan.name))
    yield Progress(0, 1, f"Measuring {title}")
    row = _row(plan, data, weights, run, seconds=read_log(folder / LOG)[0][-1]["seconds"])
    with replaced_file(folder / RECORD, NETWORK_RECORD) as file:
        file.write(json.dumps({"network": plan.name, "key": key, "row": row}, indent=1).encode())
    return row


def settings_of(plan: NetworkPlan, settings: TrainSettings) -> TrainSettings:
    """Settings of a network: those of the run, with its encoder."""
    return replace(settings, encoder=plan.encoder, encoder_width=0)


def _key(plan: NetworkPlan, data: Mapping[str, Dataset], run: NetworksRun, settings: TrainSettings) -> str:
    """Hash of all dependencies of a network's row except code."""
    drawn = {scene: [dataset.metadata["octree_hash"], dataset.metadata["settings"]] for scene, dataset in data.items()}
    what = [asdict(plan), drawn, run.samples, run.voxels, asdict(settings)]
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:32]


def _kept_row(record: Path, key: str, weights: Path) -> dict[str, Any] | None:
    """Row of a finished network: its record has this key, and belongs to the existing weights."""
    try:
        kept = json.loads(record.read_text(encoding="utf-8"))
        row: dict[str, Any] = kept["row"]
        return row if kept["key"] == key and row["hash"] == load_weights(weights).hash else None
    except (OSError, ValueError, KeyError, TypeError, WeightsFileError):
        return None


def _row(
    plan: NetworkPlan, data: Mapping[str, Dataset], weights: Weights, run: NetworksRun, *, seconds: float
) -> dict[str, Any]:
    unseen = [scene for scene in data if scene not in plan.scenes]
    return {
        "network": plan.name,
        "hash": weights.hash,
        "scenes": list(plan.scenes),
        "encoder": plan.encoder,
        "look_ahead": plan.lookahead,
        "encoder_parameters": ENCODERS[plan.encoder].parameters(plan.lookahead),
        "decoder_parameters": sum(array.size for layer in weights.decoder for array in layer),
        "passes": weights.metadata["sample_passes"],
        "seconds": seconds,
        "errors": {scene: weights_errors(weights, data[scene], run.voxels) for scene in unseen},
    }


def samples_path(out: Path, scene: str, lookahead: int) -> Path:
    """File of a scene's samples."""
    folder = out / "samples"
    return (folder if lookahead == DEFAULT_LOOKAHEAD else folder / f"look-ahead-{lookahead}") / (scene + SUFFIX)


def scene_samples(octree: Path, path: Path, count: int, settings: SampleSettings) -> Steps[Dataset]:
    """Samples of an octree file, at least `count`, from `path`, or drawn and written there.

    Raises PatchNetError for an unreadable octree or one without look-ahead, and OutputError if the samples cannot be
    written.
    """
    if (kept := _kept(octree, path, count, settings)) is not None:
        return kept
    tree = load_octree(octree)
    name = f"Drawing {path.name.partition('.')[0]}, {settings.lookahead} ahead"
    samples = yield from draw_samples(tree, count, settings, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_samples(samples, octree, tree, settings, path)
    return load_dataset(path)


def _kept(octree: Path, path: Path, count: int, settings: SampleSettings) -> Dataset | None:
    """Existing samples, if they are of this octree and these settings."""
    if not path.exists():
        return None
    try:
        dataset = load_dataset(path)
    except FileFormatError:
        return None
    drawn = len(dataset.samples.voxel) * settings.views
    same = dataset.metadata.get("settings") == asdict(settings) and count <= drawn < count + settings.views
    same = same and dataset.metadata["octree_hash"] == octree_hash(load_octree(octree))
    return dataset if same else None


def write_rows(out: Path, settings: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write networks.json into `out`; raises OutputError."""
    values = {"networks_of_paper": dict(settings), "networks": list(rows)}
    with replaced_file(out / VALUES, NETWORKS) as file:
        file.write(json.dumps(values, indent=1, allow_nan=False).encode())
