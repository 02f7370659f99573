# SPDX-License-Identifier: GPL-3.0-or-later
"""Training run of the error estimator: all forms at once, on the same pixels (methods 12.3).

All random numbers follow from the seed, so that a run gives the same weights again on the same processor.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.file_kinds import TRAINING_LOG, arrays_kind
from ...patchnet_addon.runtime.file_kinds import WEIGHTS as WEIGHTS_KIND
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.plus.forms import FORMS
from ...patchnet_addon.sampling.plus.weights import KIND, Estimators, save_estimators
from ..run.run_files import LOG, WEIGHTS
from ..run.run_log import Log
from ..run.trainer import RunOptions
from .frames import TrackSettings, views_of
from .learner import FormLearner
from .pixel_table import SYMMETRIES, PixelTable

ESTIMATORS = "plus.safetensors"
REFERENCES = "references"  # folder of references
RUN_FILES = {WEIGHTS: WEIGHTS_KIND, ESTIMATORS: arrays_kind(KIND), LOG: TRAINING_LOG}
"""The weights file contains PatchNet's weights and the estimator."""
_WARM_UP = 200  # steps
_LAST_RATE = 0.01  # of the first
_SCALED_BY = 20_000  # pixels


@dataclass(frozen=True)
class PlusSettings:
    """Settings that determine the result of a run.

    steps: of Adam. batch: pixels per step. pixels: of each frame in the table. rate: highest learning rate.
    """

    steps: int = 20_000
    batch: int = 2048
    pixels: int = 2000
    rate: float = 3e-3
    seed: int = 0


def pixels_of(
    octrees: Sequence[Path], weights: Weights, tracks: TrackSettings, settings: PlusSettings, folder: Path
) -> Steps[PixelTable]:
    """Table of pixels of all octrees' tracks; raises as `views_of`."""
    parts = []
    for number, path in enumerate(octrees):
        views = yield from views_of(path, weights, tracks, folder)
        yield Progress(number, len(octrees), "Gathering pixels")
        parts.append(PixelTable.of(views, settings.pixels, settings.seed))
    return PixelTable.joined(parts)


def train_plus(table: PixelTable, settings: PlusSettings, options: RunOptions) -> Steps[Path]:
    """Train the networks of all forms on a table, and return the path of their weights.

    Updates `log.jsonl` in `options.out` and writes `plus.safetensors` at the end. Raises PatchNetError without pixels
    or if the loss is not finite.
    """
    if len(table) == 0:
        raise PatchNetError("The octrees' tracks show no surface to train on: give octrees with surfaces")
    options.out.mkdir(parents=True, exist_ok=True)
    log, began = Log(options.out / LOG, 0), time.monotonic()
    random = np.random.default_rng(settings.seed)
    some = table.batch(random.integers(len(table), size=min(_SCALED_BY, 20 * len(table))), 0)
    learners = [
        FormLearner(form, some, float(table.errors[form.shown].mean()), settings.rate, settings.seed)
        for form in FORMS.values()
    ]
    for step in range(settings.steps):
        rows = random.integers(len(table), size=settings.batch)
        windows = table.batch(rows, int(random.integers(SYMMETRIES)))
        for learner in learners:
            learner.step(windows, table.errors[learner.form.shown][rows], rate_at(step, settings))
        if (step + 1) % options.log_steps == 0 or step + 1 == settings.steps:
            _log_means(log, learners, step + 1, time.monotonic() - began)
        yield Progress(step + 1, settings.steps, "Training")
    networks = {learner.form.name: learner.network() for learner in learners}
    extent = asdict(settings) | {"table": len(table), "minutes": round((time.monotonic() - began) / 60, 1)}
    save_estimators(Estimators(networks, options.notes | extent), options.out / ESTIMATORS)
    return options.out / ESTIMATORS


def rate_at(step: int, settings: PlusSettings) -> float:
    """Learning rate of a step: linear warm-up, then half a cosine."""
    fall = 0.5 * (1 + math.cos(math.pi * step / settings.steps))
    rise = min(1.0, (step + 1) / _WARM_UP)
    return settings.rate * rise * (_LAST_RATE + (1 - _LAST_RATE) * fall)


def _log_means(log: Log, learners: Sequence[FormLearner], step: int, seconds: float) -> None:
    """Write the mean losses since the last call; raises PatchNetError if one is not finite."""
    means = {learner.form.name: float(np.mean(learner.losses)) for learner in learners}
    for learner in learners:
        learner.losses.clear()
    if not all(map(math.isfinite, means.values())):
        raise PatchNetError(f"The loss is not finite after {step} steps: train again with a lower --rate")
    rounded = {name: round(mean, 6) for name, mean in means.items()}
    log.write({"step": step, "loss": rounded, "seconds": round(seconds, 1)})
