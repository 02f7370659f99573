# SPDX-License-Identifier: GPL-3.0-or-later
"""Training step of one network: forward pass, loss, optimiser, moving mean of the weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..patchnet_addon.network.weights import Weights
from ..patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from .batches import Batch
from .settings import TrainSettings
from .sliced_net import SlicedNet


@dataclass(frozen=True)
class Losses:
    """Mean absolute errors of a batch: of coverage, and of luminance over the views that see anything."""

    coverage: float
    luminance: float


class Learner:
    """Network, optimiser and moving mean."""

    def __init__(self, settings: TrainSettings, lookahead: int = DEFAULT_LOOKAHEAD) -> None:
        self.settings = settings
        weights = Weights.random(settings.seed, lookahead=lookahead)
        self.model, self.mean = SlicedNet(weights), SlicedNet(weights)
        self.optimizer = torch.optim.Adam(self.model.trained(), settings.learning_rate, betas=(0.9, 0.999), fused=True)
        self.steps = 0
        self.seconds = 0.0  # of training so far, over all interruptions

    def gradients(self, batch: Batch, dtype: torch.dtype) -> tuple[list[Tensor], Losses]:
        """Gradients of the loss of a batch, and its errors; the encoder's products run in `dtype`.

        Touches nothing, so that several threads may work on parts of a step.
        """
        coverage, luminance, share = errors(self.model(batch, dtype), batch)
        loss = coverage + self.settings.luminance_weight * luminance * share
        gradients = torch.autograd.grad(loss, self.model.trained())
        return list(gradients), Losses(float(coverage.detach()), float(luminance.detach()))

    def step(self, parts: list[list[Tensor]], rate: float) -> None:
        """Take one step at learning rate `rate` along the mean of the gradients of equally large parts of a batch."""
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        for parameter, *gradients in zip(self.model.trained(), *parts, strict=True):
            parameter.grad = torch.stack(gradients).mean(0) if len(gradients) > 1 else gradients[0]
        if self.settings.clip:
            torch.nn.utils.clip_grad_norm_(self.model.trained(), self.settings.clip)
        self.optimizer.step()
        self.steps += 1
        self._update_mean()

    def _update_mean(self) -> None:
        # Early on the mean would remember the random start, so its memory grows with the run.
        decay = min(self.settings.average, (1 + self.steps) / (10 + self.steps)) if self.settings.average else 0.0
        with torch.no_grad():
            for mean, value in zip(self.mean.trained(), self.model.trained(), strict=True):
                mean.lerp_(value, 1.0 - decay)

    def state(self) -> dict[str, Any]:
        """All that `load` needs to go on exactly."""
        return {
            "model": self.model.state_dict(),
            "mean": self.mean.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "steps": self.steps,
            "seconds": self.seconds,
        }

    def load(self, state: dict[str, Any]) -> None:
        """Inverse of `state`."""
        self.model.load_state_dict(state["model"])
        self.mean.load_state_dict(state["mean"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.steps, self.seconds = int(state["steps"]), float(state["seconds"])


def errors(predicted: Tensor, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Mean absolute errors of coverage and of luminance where something is seen, and the share of such views."""
    coverage = torch.from_numpy(batch.coverage)
    seen = (coverage > 0).float()
    of_coverage = (predicted[..., 0] - coverage).abs().mean()
    of_luminance = ((predicted[..., 1] - torch.from_numpy(batch.luminance)).abs() * seen).sum() / seen.sum().clamp(1)
    return of_coverage, of_luminance, seen.mean()
