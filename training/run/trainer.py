# SPDX-License-Identifier: GPL-3.0-or-later
"""Training run: batches from all data sets, checkpoints, a log of curves, validation by data set (methods 7.21).

All random numbers follow from the seed and the number of the step, so that a resumed run continues exactly.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch

from ...patchnet_addon.network.devices import CPU, enough_memory, found_device
from ...patchnet_addon.network.weights import Weights, save_weights
from ...patchnet_addon.runtime.errors import FileFormatError, OutputError, SettingError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.quantities import counted
from ...patchnet_addon.runtime.replace import replaced_path
from ...patchnet_addon.runtime.threads import usable_cores
from ..bounds import THREADS
from ..data.corpus import Corpus, corpus_of, fresh_corpus_of
from ..data.dataset import Dataset
from ..file_kinds import CHECKPOINT as CHECKPOINT_KIND
from ..settings import AUTO, BF16, OF_LENGTH, TrainSettings
from . import torch_threads
from .learner import Learner, Resumable, learning_rate, mean_errors
from .provenance import describe_data
from .run_files import CHECKPOINT, LOG, WEIGHTS, check_run
from .run_log import Log
from .steps import BATCHES, AnyCorpus, StepPlan, batches_ahead
from .validation import ValidationSet, validate, validation_sets

CHECKPOINT_S = 300.0  # time between checkpoints


@dataclass
class RunOptions:
    """Options of a run that change its result by rounding at most.

    device: cpu, cuda, cuda:N, or auto (`patchnet_addon/network/devices.py`). threads: of the CPU, for torch or for
    gathering batches for a GPU; None for one per core. validation: data sets for validation only. notes: further
    metadata of the weights.
    """

    out: Path
    resume: bool = False
    log_steps: int = 50
    validate_steps: int = 2000
    stop_after: int | None = None  # stop after this many steps with a checkpoint
    notes: dict[str, Any] = field(default_factory=dict)
    device: str = CPU
    threads: int | None = None
    validation: Sequence[Dataset] = ()


def train(datasets: Sequence[Dataset], settings: TrainSettings, options: RunOptions) -> Steps[Weights]:
    """Train on `datasets` and return the weights: the moving mean if there is one.

    Updates `checkpoint.pt`, `patchnet.safetensors` and `log.jsonl` in `options.out`. A run that is resumed on the same
    device with as many threads continues exactly, else within rounding. Raises PatchNetError if the data or the device
    cannot be used.
    """
    device = found_device(options.device)
    threads = usable_cores() if options.threads is None else options.threads
    THREADS.check(threads)
    read: Callable[..., tuple[AnyCorpus, dict[str, Corpus]]] = fresh_corpus_of if settings.fresh else corpus_of
    corpus, held_out = read(datasets, nearby=settings.kind.mixes)
    sets = validation_sets(held_out, datasets, options.validation, corpus.lookahead, nearby=corpus.nearby)
    notes = describe_data(datasets, options.validation) | options.notes
    voxels = max(1, settings.batch // corpus.views_per_voxel)
    per_step = voxels * corpus.views_per_voxel
    total = max(1, settings.passes // per_step)
    with enough_memory("training"):
        learner = Learner(settings, corpus.lookahead, device)
    check_run(options.out, resume=options.resume)
    options.out.mkdir(parents=True, exist_ok=True)
    run = asdict(settings) | {"data": list(notes["octrees"].values()), "lookahead": corpus.lookahead}
    # Identity of the samples without a hash, which would take as long as reading them.
    draws = [[*each.samples.views.shape, *asdict(each.sample_settings).values()] for each in datasets]
    run["samples"] = [] if settings.fresh else draws
    if options.resume:
        load_checkpoint(options.out / CHECKPOINT, learner, run)
        notes |= {name: run[name] for name in run if name == "extended_from"}
    plan = StepPlan(corpus, settings, voxels)
    end = min(total, options.stop_after or total)
    keeper = _Keeper(learner, options, run, notes, sets, per_step, end)
    before = time.monotonic() - learner.seconds
    title = counted(threads, "CPU thread") if device == CPU else device
    batches = batches_ahead(plan, learner.steps, end, learner.device, threads)
    try:
        for batch in batches:
            rate = learning_rate(learner.steps, total, settings)
            dtype = encoder_type(settings, learner.steps / total, device)
            with enough_memory(BATCHES), torch_threads(threads):
                gradients, sums = learner.differentiate(batch, dtype)
                learner.step(gradients, rate)
            learner.seconds = time.monotonic() - before
            keeper.keep_step(sums, rate)
            yield Progress(learner.steps, end, f"Training on {title}")
    finally:
        batches.close()
        if learner.steps:
            keeper.save()
    return learner.mean.to_weights(notes | _extent(learner, per_step))


@dataclass
class _Keeper:
    """Files of a run in progress: log, validations, checkpoints."""

    learner: Learner
    options: RunOptions
    run: dict[str, Any]
    notes: dict[str, Any]
    sets: Mapping[str, ValidationSet]
    per_step: int
    end: int

    def __post_init__(self) -> None:
        self._log = Log(self.options.out / LOG, self.learner.steps)
        self._saved = time.monotonic()

    def keep_step(self, sums: torch.Tensor, rate: float) -> None:
        """Log a step's errors, from their sums (3,); validate and save at their intervals."""
        learner, options = self.learner, self.options
        self._log.add(mean_errors(sums))
        passes, ends = learner.steps * self.per_step, learner.steps == self.end
        if learner.steps % options.log_steps == 0 or ends:
            self._log.write_means(learner.steps, passes, rate, learner.seconds)
        if learner.steps % options.validate_steps == 0 or ends:
            errors = {name: validate(learner.mean, each.corpus) for name, each in self.sets.items()}
            why = {name: each.not_held_out for name, each in self.sets.items() if each.not_held_out}
            self._log.write({"step": learner.steps, "passes": passes, "validation": errors, "not_held_out": why})
        if time.monotonic() - self._saved > CHECKPOINT_S:
            self.save()

    def save(self) -> None:
        """Write the checkpoint and the present weights."""
        notes = self.notes | _extent(self.learner, self.per_step)
        write_checkpoint(self.options.out, self.run, self.learner.state())
        save_weights(self.learner.mean.to_weights(notes), self.options.out / WEIGHTS)
        self._saved = time.monotonic()


def _extent(learner: Learner, per_step: int) -> dict[str, Any]:
    """Extent of a run so far, for metadata of weights."""
    minutes = round(learner.seconds / 60, 1)
    return {"steps": learner.steps, "sample_passes": learner.steps * per_step, "minutes": minutes}


def encoder_type(settings: TrainSettings, share: float, device: str = CPU) -> torch.dtype:
    """Number type of the encoder's products on a device after `share` of the run."""
    if settings.precision != AUTO:
        return torch.bfloat16 if settings.precision == BF16 else torch.float32
    units = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    is_fast = units.get("amx_bf16") or units.get("avx512_bf16")  # products in hardware
    return torch.bfloat16 if device == CPU and is_fast and share < 0.98 else torch.float32


def write_checkpoint(out: Path, run: dict[str, Any], state: dict[str, Any]) -> None:
    """Write the settings and the learner's state of a run atomically; raises OutputError."""
    path = out / CHECKPOINT
    try:
        with replaced_path(path, CHECKPOINT_KIND) as beside:
            torch.save({"run": run, "learner": state}, beside)
    except RuntimeError as cause:  # by torch, for a full disk
        reason = str(cause).splitlines()[0]
        raise OutputError(f"{path} cannot be written ({reason}): choose another folder or make room") from cause


def load_checkpoint(path: Path, learner: Resumable, run: dict[str, Any]) -> None:
    """Resume from a checkpoint; raises PatchNetError if it is damaged, or of another version, other settings or data.

    A run may have more passes than before, with the learning rate and warm-up of the longer run: `run` then states the
    earlier passes in `extended_from`.
    """
    try:
        state = torch.load(path, map_location=CPU, weights_only=True)
        other = state["run"]
        extended = other.get("passes", 0) < run.get("passes", 0)
        free = OF_LENGTH if extended else ()
        changed = [name for name in run if other.get(name) != run[name] and name not in free]
        if not changed:
            learner.load(state["learner"])
            earlier = [*other.get("extended_from", ()), *([other["passes"]] if extended else ())]
            run |= {"extended_from": earlier} if earlier else {}
    except (RuntimeError, KeyError, ValueError, TypeError, EOFError, pickle.UnpicklingError) as cause:
        raise FileFormatError(
            f"{path} is damaged, or of another version ({type(cause).__name__}): start the run again"
        ) from cause
    if changed:
        raise SettingError(f"{path} was written with other values of {', '.join(changed)}: resume with the same ones")
