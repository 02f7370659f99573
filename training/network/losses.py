# SPDX-License-Identifier: GPL-3.0-or-later
"""Loss of a batch, and the mean errors that a run logs (methods 7.21, 11.3).

Squared: the mean squared error of coverage, and `luminance_weight` times that of luminance where something is seen.
Absolute, the paper's: the same of absolute errors.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..data.tensor_batch import TensorBatch


def batch_loss(
    predicted: Tensor, batch: TensorBatch, *, squared: bool, luminance_weight: float
) -> tuple[Tensor, Tensor]:
    """Loss of coverage and luminance (V, R, 2), and sums (3,) for `mean_errors`.

    Sums are the mean absolute errors of coverage and of luminance, the latter 0 where nothing is seen, and the share of
    views that see something.
    """
    seen = (batch.coverage > 0).float()
    coverage, luminance = predicted[..., 0] - batch.coverage, (predicted[..., 1] - batch.luminance) * seen
    errors = torch.stack([coverage, luminance]).flatten(1)  # (2, V R)
    losses = (errors.square() if squared else errors.abs()).mean(dim=1)
    sums = torch.stack([*errors.detach().abs().mean(dim=1), seen.mean()])
    return losses[0] + luminance_weight * losses[1], sums


def mean_errors(sums: Tensor) -> Tensor:
    """Errors (2,) of a step, of coverage and of luminance where something is seen, from the sums (3,) of its parts."""
    return torch.stack([sums[0], sums[1] / sums[2].clamp(min=1e-9)])
