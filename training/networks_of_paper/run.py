# SPDX-License-Identifier: GPL-3.0-or-later
"""Run that trains the networks of a plan one after the other, and measures them on scenes that they did not see.

What is done is skipped, and a network whose training was interrupted goes on from its checkpoint.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ...patchnet_addon.network.weights import Weights, save_weights
from ...patchnet_addon.runtime.errors import WeightsFileError
from ...patchnet_addon.runtime.file_kinds import NETWORK_RECORD
from ...patchnet_addon.runtime.progress import Progress, Steps, labelled
from ...patchnet_addon.runtime.replace import replaced_file
from ..data.dataset import DATASET_SEEDS, Dataset
from ..data.samples import SampleSettings
from ..encoders import ENCODERS, load_weights
from ..run.model_card import read_log, write_card
from ..run.run_files import CHECKPOINT, LOG
from ..run.trainer import RunOptions, train
from ..run.weights_errors import weights_errors
from ..settings import TrainSettings
from .files import RECORD, network_folder, samples_path, weights_path
from .plan import NetworkPlan
from .scene_samples import scene_samples


@dataclass(frozen=True)
class NetworksRun:
    """Budget of each network of a run, and how it is carried out.

    samples: of each scene. least_level: of the voxels that they are of. settings: of the trainings, their passes are
    those of each network. voxels: of each scene that errors are measured on, at most. device, threads,
    checkpoint_minutes: as `RunOptions` says. notes: `command`, `versions` and `machine` for the model cards.
    """

    out: Path
    samples: int
    least_level: int
    settings: TrainSettings
    voxels: int
    device: str
    threads: int | None = None
    checkpoint_minutes: float = 5.0
    notes: Mapping[str, Any] = field(default_factory=dict)


def train_networks(
    octrees: Mapping[str, Path], plans: Sequence[NetworkPlan], run: NetworksRun
) -> Steps[list[dict[str, Any]]]:
    """Train the networks on octree files by name of the scene; returns a row of plain JSON values for each.

    Raises PatchNetError for octrees that samples cannot be drawn of, and for a network that was begun with other
    settings.
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
    """Row of a network, which is trained if there is no record of it with these settings."""
    folder = network_folder(run.out, plan.name)
    settings = settings_of(plan, run.settings)
    key = _key(plan, data, run, settings)
    if (kept := _kept_row(folder / RECORD, key, weights_path(run.out, plan.name))) is not None:
        return kept
    learned = [data[scene] for scene in plan.scenes]
    options = RunOptions(
        folder, (folder / CHECKPOINT).exists(), run.checkpoint_minutes, device=run.device, threads=run.threads,
        notes=dict(run.notes) | {"settings": asdict(settings)},
    )  # fmt: skip
    weights = yield from labelled(train(learned, settings, options), f"Training {title}")
    save_weights(weights, weights_path(run.out, plan.name))
    write_card(folder, learned, settings, weights.metadata, weights.hash)
    yield Progress(0, 1, f"Measuring {title}")
    row = _row(plan, data, weights, run, seconds=read_log(folder / LOG)[0][-1]["seconds"])
    with replaced_file(folder / RECORD, NETWORK_RECORD) as file:
        file.write(json.dumps({"network": plan.name, "key": key, "row": row}, indent=1).encode())
    return row


def settings_of(plan: NetworkPlan, settings: TrainSettings) -> TrainSettings:
    """Settings of a network's training: those of the run, with its encoder."""
    return replace(settings, encoder=plan.encoder, encoder_width=0)


def _key(plan: NetworkPlan, data: Mapping[str, Dataset], run: NetworksRun, settings: TrainSettings) -> str:
    """Hash of all that a network's row depends on but the code."""
    drawn = {scene: [dataset.metadata["octree_hash"], dataset.metadata["settings"]] for scene, dataset in data.items()}
    what = [asdict(plan), drawn, run.samples, run.voxels, asdict(settings)]
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:32]


def _kept_row(record: Path, key: str, weights: Path) -> dict[str, Any] | None:
    """Row of a network that is done: its record has this key, and is of the weights that are there."""
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
        "errors": {scene: weights_errors(weights, data[scene], run.voxels)["all"] for scene in unseen},
    }
