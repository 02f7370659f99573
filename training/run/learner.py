# SPDX-License-Identifier: GPL-3.0-or-later
"""Training step of one network: forward pass, loss, optimizer, moving mean of the weights; and the learning rates.

The squared loss (methods 7.21) is the mean squared error of coverage plus `luminance_weight` times that of
luminance in views with coverage; the absolute loss, the paper's, has absolute errors instead.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from ...patchnet_addon.network.torch_encode import float32_products
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ..data.batches import Batch
from ..network.patchnet import PatchNet
from ..settings import SQUARED, TF32, TrainSettings


class Resumable:
    """Training state with the number of steps, and their seconds over all interruptions."""

    def __init__(self, **parts: Any) -> None:
        """Parts of the state by name: modules and optimisers of torch."""
        self._parts = parts
        self.steps, self.seconds = 0, 0.0

    def state(self) -> dict[str, Any]:
        """State from which `load` continues exactly, on any device."""
        parts = {name: part.state_dict() for name, part in self._parts.items()}
        return parts | {"steps": self.steps, "seconds": self.seconds}

    def load(self, state: dict[str, Any]) -> None:
        """Inverse of `state`; raises RuntimeError, KeyError or ValueError for an incomplete one."""
        for name, part in self._parts.items():
            part.load_state_dict(state[name])
        self.steps, self.seconds = int(state["steps"]), float(state["seconds"])


class Learner(Resumable):
    """Network, optimiser and moving mean, on one device."""

    def __init__(self, settings: TrainSettings, lookahead: int = DEFAULT_LOOKAHEAD, device: str = CPU) -> None:
        self.settings, self.device = settings, torch.device(device)
        weights = Weights.random(settings.seed, lookahead=lookahead, kind=settings.kind, encoder=settings.encoder_kind)
        self.model, self.mean = (PatchNet(weights).to(self.device) for _ in range(2))
        self.optimizer = torch.optim.Adam(self.model.parameters(), settings.learning_rate, fused=True)
        super().__init__(model=self.model, mean=self.mean, optimizer=self.optimizer)

    def differentiate(self, batch: Batch, dtype: torch.dtype) -> tuple[list[Tensor], Tensor]:
        """Gradients of a batch's loss by all parameters, and sums (3,) for `mean_errors`. The encoder's products run in
        `dtype`.
        """
        settings = self.settings
        with float32_products(self.device, tf32=settings.precision == TF32):
            predicted = self.model(batch, dtype)
            squared, weight = settings.loss == SQUARED, settings.luminance_weight
            loss, sums = batch_loss(predicted, batch, squared=squared, luminance_weight=weight)
            gradients = torch.autograd.grad(loss, list(self.model.parameters()))
        return list(gradients), sums

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
        # The window of the mean grows with the run, so that it forgets the random start.
        decay = min(self.settings.average, (1 + self.steps) / (10 + self.steps)) if self.settings.average else 0.0
        with torch.no_grad():
            for mean, parameter in zip(self.mean.parameters(), parameters, strict=True):
                mean.lerp_(parameter, 1.0 - decay)


def batch_loss(predicted: Tensor, batch: Batch, *, squared: bool, luminance_weight: float) -> tuple[Tensor, Tensor]:
    """Loss of coverage and luminance (V, R, 2), and sums (3,) for `mean_errors`.

    Sums are the mean absolute errors of coverage and of luminance, 0 in views without coverage, and the share of views
    with coverage.
    """
    seen = (batch.coverage > 0).float()
    coverage, luminance = predicted[..., 0] - batch.coverage, (predicted[..., 1] - batch.luminance) * seen
    errors = torch.stack([coverage, luminance]).flatten(1)  # (2, V R)
    losses = (errors.square() if squared else errors.abs()).mean(dim=1)
    sums = torch.stack([*errors.detach().abs().mean(dim=1), seen.mean()])
    return losses[0] + luminance_weight * losses[1], sums


def mean_errors(sums: Tensor) -> Tensor:
    """Errors (2,) of a step, of coverage and of luminance in views with coverage, from its sums (3,)."""
    return torch.stack([sums[0], sums[1] / sums[2].clamp(min=1e-9)])


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
