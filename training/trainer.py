# SPDX-License-Identifier: GPL-3.0-or-later
"""The training run: batches from all data sets, checkpoints, a log of curves, validation by scene (methods 7.21).

Everything random follows from the seed and the number of the step, so a run that was interrupted continues as if it
had not been.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ..patchnet_addon.errors import FileFormatError, PatchNetError, SettingError
from ..patchnet_addon.network.weights import Weights, save_weights
from ..patchnet_addon.progress import Progress, Steps
from .batches import Augmentation, Batch, gather_batch
from .dataset import Dataset
from .forest import Forest, plant
from .learner import Learner, Losses
from .schedule import learning_rate
from .settings import TrainSettings
from .validation import validate

CHECKPOINT = "checkpoint.pt"
LOG = "log.jsonl"
WEIGHTS = "patchnet.safetensors"


@dataclass(frozen=True, eq=False)
class Corpus:
    """The voxels of all data sets to train on: tree (G,) int32, voxel (G, 4), views (G, R, 12)."""

    forest: Forest
    tree: np.ndarray
    voxel: np.ndarray
    views: np.ndarray

    def batch(self, rows: np.ndarray, augmentation: Augmentation) -> Batch:
        """Batch of the voxels `rows` (V,)."""
        return gather_batch(self.forest, self.tree[rows], self.voxel[rows], self.views[rows], augmentation)


@dataclass
class RunOptions:
    """How a run is carried out, none of which changes its result."""

    out: Path
    resume: bool = False
    checkpoint_minutes: float = 5.0
    log_steps: int = 50
    validate_steps: int = 2000
    stop_after: int | None = None  # end early after this many steps, leaving a checkpoint
    notes: dict[str, Any] = field(default_factory=dict)


def train(datasets: Sequence[Dataset], settings: TrainSettings, options: RunOptions) -> Steps[Weights]:
    """Train on `datasets` and return the weights, the moving mean if there is one.

    Keeps `checkpoint.pt`, `patchnet.safetensors` and `log.jsonl` in `options.out` up to date. Raises PatchNetError if
    the data cannot be used.
    """
    corpus, held_out = corpus_of(datasets)
    voxels = max(1, settings.batch // corpus.views.shape[1])
    per_step = voxels * corpus.views.shape[1]
    total = max(1, settings.passes // per_step)
    learner = Learner(settings)
    options.out.mkdir(parents=True, exist_ok=True)
    run = asdict(settings) | {"data": [dataset.metadata.get("octree_hash", dataset.name) for dataset in datasets]}
    if options.resume:
        load_checkpoint(options.out / CHECKPOINT, learner, run)
    elif (options.out / CHECKPOINT).exists():
        raise SettingError(f"{options.out} holds a run already: continue it with --resume or choose another folder")
    log = Log(options.out / LOG, learner.steps)
    end = min(total, options.stop_after or total)
    before, saved = time.monotonic() - learner.seconds, time.monotonic()
    try:
        for batch in ahead(batches(corpus, settings, voxels, learner.steps, end)):
            rate = learning_rate(learner.steps, total, settings)
            log.add(learner.step(batch, rate, encoder_type(settings, learner.steps / total)))
            learner.seconds = time.monotonic() - before
            passes = learner.steps * per_step
            if learner.steps % options.log_steps == 0 or learner.steps == end:
                log.write_means(learner.steps, passes, rate, learner.seconds)
            if learner.steps % options.validate_steps == 0 or learner.steps == end:
                errors = validate(learner.mean, held_out)
                log.write({"step": learner.steps, "passes": passes, "validation": errors})
            if time.monotonic() - saved > 60 * options.checkpoint_minutes:
                save_checkpoint(options.out, learner, run, options.notes | _extent(learner, per_step))
                saved = time.monotonic()
            yield Progress(learner.steps, end, "Training")
    finally:
        if learner.steps:
            save_checkpoint(options.out, learner, run, options.notes | _extent(learner, per_step))
    return learner.mean.to_weights(options.notes | _extent(learner, per_step))


def _extent(learner: Learner, per_step: int) -> dict[str, Any]:
    """How far a run is, for the metadata of its weights."""
    minutes = round(learner.seconds / 60, 1)
    return {"steps": learner.steps, "sample_passes": learner.steps * per_step, "minutes": minutes}


def corpus_of(datasets: Sequence[Dataset]) -> tuple[Corpus, dict[str, Corpus]]:
    """All voxels to train on, and those held out, by data set; raises PatchNetError if there are none."""
    if not datasets:
        raise SettingError("There is nothing to train on: name at least one sample file")
    views = {dataset.samples.views.shape[1] for dataset in datasets}
    if len(views) != 1:
        raise SettingError(f"The sample files hold {sorted(views)} views per voxel: draw them with the same number")
    forest = plant([dataset.octree for dataset in datasets])
    parts = []
    held_out = {}
    for number, dataset in enumerate(datasets):
        samples = dataset.samples
        tree = np.full(len(samples.voxel), number, np.int32)
        keep, held = np.flatnonzero(~samples.held_out), np.flatnonzero(samples.held_out)
        parts.append((tree[keep], samples.voxel[keep], samples.views[keep]))
        if len(held):
            held_out[dataset.name] = Corpus(forest, tree[held], samples.voxel[held], samples.views[held])
    tree, voxel, view = (np.concatenate([part[k] for part in parts]) for k in range(3))
    if not len(tree):
        raise PatchNetError("All samples are held out for validation: draw more of them")
    return Corpus(forest, tree, voxel, view), held_out


def batches(corpus: Corpus, settings: TrainSettings, voxels: int, first: int, last: int) -> Iterator[Batch]:
    """Batches of steps `first` to `last`; each epoch runs through all voxels in a new order."""
    count = len(corpus.tree)
    epoch, order = -1, np.zeros(0, np.int64)
    for step in range(first, last):
        start = step * voxels
        rows = np.empty(0, np.int64)
        while len(rows) < voxels:
            at = start + len(rows)
            if at // count != epoch:
                epoch = at // count
                order = np.random.default_rng([settings.seed, 1, epoch]).permutation(count)
            rows = np.concatenate([rows, order[at % count : at % count + voxels - len(rows)]])
        random = np.random.default_rng([settings.seed, 2, step])
        yield corpus.batch(rows, Augmentation.random(voxels, random) if settings.augment else Augmentation.none(voxels))


def ahead(items: Iterator[Batch]) -> Iterator[Batch]:
    """The same batches, each gathered in a second thread while the one before it is learned from."""
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(next, items, None)
        while (item := waiting.result()) is not None:
            waiting = pool.submit(next, items, None)
            yield item


def encoder_type(settings: TrainSettings, share: float) -> torch.dtype:
    """Number type of the encoder's products when `share` of the run is done."""
    if settings.precision == "auto":
        return torch.bfloat16 if has_fast_bf16() and share < 7 / 8 else torch.float32
    return torch.bfloat16 if settings.precision == "bf16" else torch.float32


def has_fast_bf16() -> bool:
    """Whether this processor multiplies bf16 matrices in hardware."""
    capability = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return bool(capability.get("amx_bf16") or capability.get("avx512_bf16"))


def save_checkpoint(out: Path, learner: Learner, run: dict[str, Any], notes: dict[str, Any]) -> None:
    """Write the state of a run and the weights it would end with now, each atomically."""
    beside = out / (CHECKPOINT + ".tmp")
    torch.save({"run": run, "learner": learner.state()}, beside)
    os.replace(beside, out / CHECKPOINT)
    save_weights(learner.mean.to_weights(notes), out / WEIGHTS)


def load_checkpoint(path: Path, learner: Learner, run: dict[str, Any]) -> None:
    """Go on from a checkpoint; raises PatchNetError if it is missing, damaged or of other settings or data."""
    if not path.is_file():
        raise FileFormatError(f"{path} does not exist: start the run without --resume")
    try:
        state = torch.load(path, weights_only=True)
        other = state["run"]
        learner.load(state["learner"])
    except (RuntimeError, KeyError, ValueError, EOFError) as cause:
        raise FileFormatError(f"{path} is damaged ({cause}): start the run anew") from cause
    changed = [name for name in run if other.get(name) != run[name]]
    if changed:
        raise SettingError(f"{path} was written with other values of {', '.join(changed)}: resume with the same ones")


class Log:
    """Curves as JSON lines."""

    def __init__(self, path: Path, steps: int) -> None:
        """Continue the log of a run that has done `steps`; what an interrupted run wrote after them is dropped."""
        lines = path.read_text().splitlines() if steps and path.is_file() else []
        kept = [line for line in lines if json.loads(line)["step"] <= steps]
        path.write_text("".join(line + "\n" for line in kept))
        self._path = path
        self._losses: list[Losses] = []

    def add(self, losses: Losses) -> None:
        """Remember the errors of one step."""
        self._losses.append(losses)

    def write_means(self, step: int, passes: int, rate: float, seconds: float) -> None:
        """Write the mean errors since the last time."""
        coverage = float(np.mean([losses.coverage for losses in self._losses]))
        luminance = float(np.mean([losses.luminance for losses in self._losses]))
        self._losses.clear()
        errors = {"coverage": round(coverage, 6), "luminance": round(luminance, 6)}
        self.write({"step": step, "passes": passes, "seconds": round(seconds, 1), "rate": rate} | errors)

    def write(self, entry: dict[str, Any]) -> None:
        """Append one line."""
        with self._path.open("a") as file:
            file.write(json.dumps(entry) + "\n")
