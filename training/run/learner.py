# SPDX-License-Identifier: GPL-3.0-or-later
"""Training step of one network: forward pass, loss, optimiser, moving mean of the weights; and the learning rates."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from ...patchnet_addon.network.torch_precision import float32_products
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ..data.tensor_batch import TensorBatch
from ..network.losses import batch_loss
from ..network.patchnet import PatchNet
from ..settings import SQUARED, TF32, TrainSettings


class Learner:
    """Network, optimiser and moving mean, on one device."""

    def __init__(self, settings: TrainSettings, lookahead: int = DEFAULT_LOOKAHEAD, device: str = CPU) -> None:
        self.settings, self.device = settings, torch.device(device)
        weights = Weights.random(settings.seed, lookahead=lookahead, kind=settings.kind, encoder=settings.encoder_kind)
        self.model, self.mean = (PatchNet(weights).to(self.device) for _ in range(2))
        self.optimizer = torch.optim.Adam(self.model.parameters(), settings.learning_rate, fused=True)
        self.steps = 0
        self.seconds = 0.0  # of training so far, over all interruptions

    def differentiate(self, batch: TensorBatch, dtype: torch.dtype, share: float = 1.0) -> tuple[list[Tensor], Tensor]:
        """Gradients of the loss of a batch by all parameters, and its sums (3,) for `mean_errors`.

        share: of the step that the batch is; both are multiplied by it, so that those of all parts add up. The
        encoder's products run in `dtype`.
        """
        settings = self.settings
        with float32_products(self.device, tf32=settings.precision == TF32):
            predicted = self.model(batch, dtype)
            squared, weight = settings.loss == SQUARED, settings.luminance_weight
            loss, sums = batch_loss(predicted, batch, squared=squared, luminance_weight=weight)
            gradients = torch.autograd.grad(share * loss, list(self.model.parameters()))
        return list(gradients), share * sums

    def step(self, gradients: list[Tensor], rate: float) -> None:
        """Take one step at learning rate `rate` along the gradients."""
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        parameters = list(self.model.parameters())
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        if self.settings.clip:
            torch.nn.utils.clip_grad_norm_(parameters, self.settings.clip)
        self.optimizer.step()
        self.steps += 1
        # Early on the mean would remember the random start, so its memory grows with the run.
        decay = min(self.settings.average, (1 + self.steps) / (10 + self.steps)) if self.settings.average else 0.0
        with torch.no_grad():
            for mean, parameter in zip(self.mean.parameters(), parameters, strict=True):
                mean.lerp_(parameter, 1.0 - decay)

    def state(self) -> dict[str, Any]:
        """All that `load` needs to go on exactly, on whatever device."""
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


def learning_rate(step: int, total: int, settings: TrainSettings) -> float:
    """Learning rate of step `step` of `total`, counted from 0."""
    first, last = settings.learning_rate, settings.final_rate
    if step < settings.warm_up:
        return first * (step + 1) / settings.warm_up
    if settings.schedule == "paper":
        share = step / total
        return first if share < 4 / 8 else math.sqrt(first * last) if share < 7 / 8 else last
    share = (step - settings.warm_up) / max(1, total - settings.warm_up)
    return last + 0.5 * (first - last) * (1 + math.cos(math.pi * min(share, 1.0)))
