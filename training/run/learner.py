# SPDX-License-Identifier: GPL-3.0-or-later
"""Training step of one network: forward pass, loss, optimiser, moving mean of the weights."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from ...patchnet_addon.network.torch_precision import float32_products
from ...patchnet_addon.network.weights import Weights
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ..data.batches import Batch
from ..data.tensor_batch import TensorBatch
from ..network.cpu_adam import CpuAdam
from ..network.flat_memory import flat_gradient
from ..network.gpu_adam import GpuAdam
from ..network.losses import loss_gradient
from ..network.sliced_net import SlicedNet
from ..network.tiled_step import TiledStep, fits, sizes_of
from ..settings import FP32, SQUARED, TF32, TrainSettings


class Learner:
    """Network, optimiser and moving mean, on one device."""

    def __init__(self, settings: TrainSettings, lookahead: int = DEFAULT_LOOKAHEAD, device: str = CPU) -> None:
        self.settings, self.device = settings, torch.device(device)
        weights = Weights.random(settings.seed, lookahead=lookahead, kind=settings.kind, encoder=settings.encoder_kind)
        self.model, self.mean = (SlicedNet(weights).to(self.device) for _ in range(2))
        # Lists once: to walk through the modules at every step takes as long as some of its products.
        self._trained, self._means = (list[Tensor](net.trained()) for net in (self.model, self.mean))
        self.optimizer = torch.optim.Adam(self._trained, settings.learning_rate, betas=(0.9, 0.999), fused=True)
        self._tiled = self._tiled_step()
        self._adam = self._adam_of_device()
        self.steps = 0
        self.seconds = 0.0  # of training so far, over all interruptions

    def multiplies_in_units(self, dtype: torch.dtype) -> bool:
        """Whether gradients by products of the encoder in `dtype` are computed in the processor's matrix units."""
        return self._tiled_for(dtype) is not None

    def _tiled_for(self, dtype: torch.dtype) -> TiledStep | None:
        return self._tiled if dtype == torch.bfloat16 else None

    def gradients(self, batch: Batch | TensorBatch, dtype: torch.dtype, share: float = 1.0) -> tuple[Tensor, Tensor]:
        """Gradient (n,) of the loss of a batch, all parameters' in a row, and its sums (3,) for `mean_errors`.

        share: of the step that the batch is; both are multiplied by it, so that those of all parts add up. The
        encoder's products run in `dtype`; blocks of a `Batch` are of that type. Touches nothing, so that several
        threads may work on parts of a step.
        """
        if isinstance(batch, Batch):
            tiled = self._tiled_for(dtype)
            if tiled is not None:
                return tiled.gradients(batch, share)
            batch = TensorBatch.of(batch)
        with float32_products(self.device, tf32=self.settings.precision == TF32):
            predicted = self.model(batch, dtype)
            squared, weight = self.settings.loss == SQUARED, self.settings.luminance_weight
            gradient, sums = loss_gradient(predicted, batch, squared=squared, luminance_weight=weight)
            gradients = torch.autograd.grad(predicted, self._trained, share * gradient)
        return flat_gradient(gradients), share * sums

    def step(self, parts: list[Tensor], rate: float) -> None:
        """Take one step at learning rate `rate` along the sum of the gradients (n,) of the parts of a step.

        The sum is made in the memory of the first part. On the CPU all threads that `run_parts` may use take the step.
        """
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.steps += 1
        # Early on the mean would remember the random start, so its memory grows with the run.
        decay = min(self.settings.average, (1 + self.steps) / (10 + self.steps)) if self.settings.average else 0.0
        if isinstance(self._adam, CpuAdam):
            self._adam.step(parts, share=1.0 - decay)
        else:
            (only,) = parts
            self._adam.step(only, share=1.0 - decay)

    def _tiled_step(self) -> TiledStep | None:
        """What computes gradients in matrix units, where these are and the settings let them be used."""
        settings, slices = self.settings, self.model.slices
        if self.device.type != CPU or settings.precision == FP32 or slices is None or not fits(slices):
            return None
        sizes, squared = sizes_of(slices, settings.kind), settings.loss == SQUARED
        return TiledStep(self._trained, sizes, squared=squared, luminance_weight=settings.luminance_weight)

    def _adam_of_device(self) -> CpuAdam | GpuAdam:
        if self.device.type == CPU:
            packed = self._tiled.packed if self._tiled else None
            return CpuAdam(self.optimizer, self._means, self.settings.clip, packed)
        return GpuAdam(self.optimizer, self._means, self.settings.clip)

    def state(self) -> dict[str, Any]:
        """All that `load` needs to go on exactly, on whatever device."""
        self._adam.store()
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
        self._adam = self._adam_of_device()  # of the state that now is
        self.steps, self.seconds = int(state["steps"]), float(state["seconds"])
