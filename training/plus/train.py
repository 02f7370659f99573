# SPDX-License-Identifier: GPL-3.0-or-later
"""Training run of the error estimator: all forms at once, on the same pixels (methods 12.3).

All random numbers follow from the seed, so that a run gives the same weights again on the same processor.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.file_kinds import arrays_kind
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.sampling.plus.features import HIGHEST, LOWEST, features_of
from ...patchnet_addon.sampling.plus.forms import FORMS, Form, Plane
from ...patchnet_addon.sampling.plus.weights import KIND, Estimators, Network, layer_sizes, save_estimators
from ..file_kinds import TRAINING_LOG
from ..file_kinds import WEIGHTS as WEIGHTS_KIND
from ..run.run_files import LOG, WEIGHTS
from ..run.run_log import Log
from ..run.trainer import RunOptions
from .frames import SYMMETRIES, PixelTable

ESTIMATORS = "plus.safetensors"
RUN_FILES = {WEIGHTS: WEIGHTS_KIND, ESTIMATORS: arrays_kind(KIND), LOG: TRAINING_LOG}
"""The weights file contains PatchNet's weights and the estimator."""
_WARM_UP = 200  # steps
_LAST_RATE = 0.01  # of the first
_SCALED_BY = 20_000  # pixels
_MOVING = 0.002  # share of the present weights in the moving mean, per step
_POWER = 1.25  # 1 is Poisson's distribution, 2 the gamma distribution: higher values weigh small errors more
_FIRST_MEAN = 0.3  # initial ratio of error and scale


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


class FormLearner:
    """Network of a form, trained on windows of pixels and their squared errors.

    mean, deviation: (F,) float32 of the features, for normalization. unit: mean squared error of all pixels, the unit
    of the loss.
    """

    def __init__(self, form: Form, windows: np.ndarray, unit: float, rate: float, seed: int) -> None:
        """Create the network of a form; windows: (C, 9, N) of all planes of some pixels, to normalize features."""
        self.form, self.unit, self.losses = form, max(unit, 1e-12), list[float]()
        features, _ = features_of(windows, form, tuple(Plane))
        self.mean, self.deviation = features.mean(axis=1), features.std(axis=1) + np.float32(1e-3)
        count, hidden, _, outputs = layer_sizes(form)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            layers = nn.Linear(count, hidden), nn.Linear(hidden, hidden), nn.Linear(hidden, outputs)
        self.skip = nn.Parameter(torch.zeros(count))
        with torch.no_grad():
            layers[-1].weight.zero_()
            layers[-1].bias.copy_(torch.tensor([0.0, _FIRST_MEAN]))
        self.model = nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])
        self.parameters = [*self.model.parameters(), self.skip]
        self.moving = [parameter.detach().clone() for parameter in self.parameters]
        self.optimizer = torch.optim.Adam(self.parameters, rate)
        self.steps = 0

    def step(self, windows: np.ndarray, errors: np.ndarray, rate: float) -> None:
        """Take one step with windows (C, 9, B) of pixels and squared errors (B,), at a learning rate."""
        features, scale = features_of(windows, self.form, tuple(Plane))
        inputs = ((features - self.mean[:, None]) / self.deviation[:, None]).T
        expected = torch.from_numpy(scale) * self._outputs(torch.from_numpy(np.ascontiguousarray(inputs)))
        # Deviance of Tweedie's distribution up to constants: its minimum is the mean for any distribution.
        # A constant mean of all pixels has a deviance of 1.
        ratio, true = expected / self.unit, torch.from_numpy(errors / np.float32(self.unit))
        loss = ((_POWER - 1) * ratio ** (2 - _POWER) + (2 - _POWER) * true * ratio ** (1 - _POWER)).mean()
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.steps += 1
        self.losses.append(loss.item())
        share = max(_MOVING, 1 / self.steps)
        with torch.no_grad():
            for moving, parameter in zip(self.moving, self.parameters, strict=True):
                moving.lerp_(parameter, share)

    def network(self) -> Network:
        """Network of the moving mean, for raw features."""
        *arrays, skip = (moving.numpy().astype(np.float64) for moving in self.moving)
        (first, bias), *others = zip(arrays[::2], arrays[1::2], strict=True)
        first, skip = first / self.deviation, skip / self.deviation
        others[-1][1][1] -= skip @ self.mean  # of the second output
        layers = [(first, bias - first @ self.mean), *others]
        return Network(
            tuple((matrix.astype(np.float32), offset.astype(np.float32)) for matrix, offset in layers),
            skip.astype(np.float32),
        )

    def _outputs(self, inputs: torch.Tensor) -> torch.Tensor:
        """Expected squared error over the squared scale, (B,)."""
        variance, mean = self.model(inputs).unbind(1)
        return (mean + inputs @ self.skip) ** 2 + torch.exp(variance.clamp(LOWEST, HIGHEST))


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
        # Linear warm-up, then half a cosine.
        fall = 0.5 * (1 + math.cos(math.pi * step / settings.steps))
        rate = settings.rate * min(1.0, (step + 1) / _WARM_UP) * (_LAST_RATE + (1 - _LAST_RATE) * fall)
        rows = random.integers(len(table), size=settings.batch)
        windows = table.batch(rows, int(random.integers(SYMMETRIES)))
        for learner in learners:
            learner.step(windows, table.errors[learner.form.shown][rows], rate)
        if (step + 1) % options.log_steps == 0 or step + 1 == settings.steps:
            means = {learner.form.name: float(np.mean(learner.losses)) for learner in learners}
            for learner in learners:
                learner.losses.clear()
            if not all(map(math.isfinite, means.values())):
                raise PatchNetError(f"The loss is not finite after {step + 1} steps: train again with a lower --rate")
            rounded = {name: round(mean, 6) for name, mean in means.items()}
            log.write({"step": step + 1, "loss": rounded, "seconds": round(time.monotonic() - began, 1)})
        yield Progress(step + 1, settings.steps, "Training")
    networks = {learner.form.name: learner.network() for learner in learners}
    extent = asdict(settings) | {"table": len(table), "minutes": round((time.monotonic() - began) / 60, 1)}
    save_estimators(Estimators(networks, options.notes | extent), options.out / ESTIMATORS)
    return options.out / ESTIMATORS
