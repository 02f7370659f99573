# SPDX-License-Identifier: GPL-3.0-or-later
"""Losses of a batch: their gradient by what the network says, and the mean errors that a run logs (methods 7.21, 11.3).

Squared: the mean squared error of coverage, and `luminance_weight` times that of luminance where something is seen.
Absolute, the paper's: the same of absolute errors.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...patchnet_addon.network.devices import CPU
from ...patchnet_addon.runtime.kernels import kernel
from ..data.tensor_batch import TensorBatch


def loss_gradient(
    predicted: Tensor, batch: TensorBatch, *, squared: bool, luminance_weight: float
) -> tuple[Tensor, Tensor]:
    """Gradient (V, R, 2) of the loss by coverage and luminance (V, R, 2), and sums (3,) for `mean_errors`.

    Sums are the mean absolute errors of coverage and of luminance, the latter 0 where nothing is seen, and the share of
    views that see something. On the CPU by one kernel.
    """
    if predicted.device.type != CPU:
        return loss_gradient_reference(predicted, batch, squared=squared, luminance_weight=luminance_weight)
    gradient, sums = np.empty(predicted.shape, np.float32), np.zeros(3)
    wanted = batch.coverage.numpy(), batch.luminance.numpy()
    how = squared, np.float32(luminance_weight), np.float32(1)
    measure_errors(predicted.detach().numpy(), *wanted, *how, gradient, sums)
    return torch.from_numpy(gradient), torch.from_numpy(sums.astype(np.float32))


def loss_gradient_reference(
    predicted: Tensor, batch: TensorBatch, *, squared: bool, luminance_weight: float
) -> tuple[Tensor, Tensor]:
    """Reference of `loss_gradient` by torch, on any device."""
    seen = (batch.coverage > 0).float()
    found = predicted.detach()
    errors = torch.stack([found[..., 0] - batch.coverage, (found[..., 1] - batch.luminance) * seen], dim=-1)
    slopes = (2 * errors if squared else errors.sign()) / seen.numel()
    gradient = torch.stack([slopes[..., 0], luminance_weight * slopes[..., 1]], dim=-1)
    return gradient, torch.stack([*errors.abs().mean(dim=(0, 1)), seen.mean()])


def mean_errors(sums: Tensor) -> Tensor:
    """Errors (2,) of a step, of coverage and of luminance where something is seen, from the sums (3,) of its parts."""
    return torch.stack([sums[0], sums[1] / sums[2].clamp(min=1e-9)])


@kernel
def measure_errors(predicted, coverage, luminance, squared, luminance_weight, scale, gradient, sums):
    """Write the gradient and the sums of `loss_gradient`, both times `scale`."""
    voxels, views = coverage.shape
    share = np.float32(scale / (voxels * views))
    of_coverage, of_luminance, seen = 0.0, 0.0, 0
    for v in range(voxels):
        for r in range(views):
            first, second = predicted[v, r, 0] - coverage[v, r], predicted[v, r, 1] - luminance[v, r]
            if coverage[v, r] > 0:
                seen += 1
            else:
                second = np.float32(0)
            of_coverage += abs(first)
            of_luminance += abs(second)
            if squared:
                first, second = np.float32(2) * first, np.float32(2) * second
            else:
                first, second = np.sign(first), np.sign(second)
            gradient[v, r, 0], gradient[v, r, 1] = share * first, share * luminance_weight * second
    sums[0], sums[1], sums[2] = of_coverage * share, of_luminance * share, seen * share
