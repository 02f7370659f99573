# SPDX-License-Identifier: GPL-3.0-or-later
"""One network in training: forward pass, loss, optimiser step, moving mean of the weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as functional
from torch import Tensor

from ..patchnet_addon.network.torch_model import PatchNet
from .batches import Batch
from .corner_layer import CornerLayer
from .settings import TrainSettings


@dataclass(frozen=True)
class Losses:
    """Mean absolute errors of a batch: of coverage, and of luminance over the views that see anything."""

    coverage: float
    luminance: float


class Learner:
    """Network, optimiser and moving mean."""

    def __init__(self, settings: TrainSettings) -> None:
        self.settings = settings
        self.model = PatchNet(settings.seed)
        self.mean = PatchNet(settings.seed)
        self.optimizer = torch.optim.Adam(
            self.model.parameters(), settings.learning_rate, betas=(0.9, 0.999), fused=True
        )
        self.steps = 0
        self.seconds = 0.0  # of training so far, over all interruptions

    def gradients(self, batch: Batch, dtype: torch.dtype) -> tuple[list[Tensor], Losses]:
        """Gradients of the loss of a batch, and its errors; the encoder's products run in `dtype`.

        Touches nothing, so that several threads may work on parts of a step.
        """
        coverage, luminance, share = errors(predict(self.model, batch, dtype), batch)
        loss = coverage + self.settings.luminance_weight * luminance * share
        gradients = torch.autograd.grad(loss, list(self.model.parameters()))
        return list(gradients), Losses(float(coverage.detach()), float(luminance.detach()))

    def step(self, parts: list[list[Tensor]], rate: float) -> None:
        """Take one step at learning rate `rate` along the mean of the gradients of equally large parts of a batch."""
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        for parameter, *gradients in zip(self.model.parameters(), *parts, strict=True):
            parameter.grad = torch.stack(gradients).mean(0) if len(gradients) > 1 else gradients[0]
        if self.settings.clip:
            torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.settings.clip)
        self.optimizer.step()
        self.steps += 1
        self._update_mean()

    def _update_mean(self) -> None:
        # Early on the mean would remember the random start, so its memory grows with the run.
        decay = min(self.settings.average, (1 + self.steps) / (10 + self.steps)) if self.settings.average else 0.0
        with torch.no_grad():
            torch._foreach_lerp_(list(self.mean.parameters()), list(self.model.parameters()), 1.0 - decay)

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


def predict(model: PatchNet, batch: Batch, dtype: torch.dtype) -> Tensor:
    """Coverage and luminance (V, R, 2) in [-1, 2]; codes and decoder in float32 whatever the encoder's `dtype`."""
    voxels, views = batch.ratio.shape
    blocks = torch.from_numpy(batch.blocks).to(dtype)
    first, *middle, last = model.encoder
    pairs = torch.from_numpy(batch.pair_block), torch.from_numpy(batch.pair_corner)
    hidden = CornerLayer.apply(first.weight, blocks, batch.slice_start.tolist(), *pairs, 8 * voxels)
    hidden = torch.relu(hidden + first.bias.to(dtype))
    for layer in middle:
        hidden = torch.relu(functional.linear(hidden, layer.weight.to(dtype), layer.bias.to(dtype)))
    codes = last(hidden.float()).view(voxels, 8, -1)
    codes = torch.bmm(corner_shares(torch.from_numpy(batch.entry)), codes)  # (V, R, 10)
    flat = [torch.from_numpy(array).reshape(voxels * views, -1) for array in (batch.direction, batch.up)]
    ratio = torch.from_numpy(batch.ratio).reshape(-1)
    return model.decode(codes.reshape(voxels * views, -1), *flat, ratio).view(voxels, views, 2)


def corner_shares(entry: Tensor) -> Tensor:
    """Trilinear shares (V, R, 8) of a voxel's corners, x fastest, at points (V, R, 3) in [0, 1]^3."""
    x, y, z = torch.stack([1 - entry, entry], dim=-1).unbind(2)  # each (V, R, 2)
    return (z[..., :, None, None] * y[..., None, :, None] * x[..., None, None, :]).flatten(2)


def errors(predicted: Tensor, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Mean absolute errors of coverage and of luminance where something is seen, and the share of such views."""
    coverage = torch.from_numpy(batch.coverage)
    seen = (coverage > 0).float()
    of_coverage = (predicted[..., 0] - coverage).abs().mean()
    of_luminance = ((predicted[..., 1] - torch.from_numpy(batch.luminance)).abs() * seen).sum() / seen.sum().clamp(1)
    return of_coverage, of_luminance, seen.mean()
