# SPDX-License-Identifier: GPL-3.0-or-later
"""Pull-push inpainting of sparse samples (Gortler, Grzeszczuk, Szeliski, Cohen, "The Lumigraph", 1996), in torch."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

_EPSILON = 1e-6


def pull_push(values: Tensor, weights: Tensor) -> Tensor:
    """Fill pictures (B, H, W) where their weights (B, H, W), in [0, 1], are small; gradients reach the weights.

    Pull: each coarser pixel is the weighted mean of 2 x 2, with the sum of their weights, at most 1. Push: what a
    weight leaves of a pixel is filled from the coarser picture.
    """
    return _filled(values[:, None], weights[:, None])[:, 0]


def _filled(values: Tensor, weights: Tensor) -> Tensor:
    """Filled pictures (B, 1, H, W)."""
    height, width = values.shape[2:]
    if max(height, width) == 1:
        return values
    odd = [0, width % 2, 0, height % 2]  # weights of 0 beyond the border
    values_even, weights_even = functional.pad(values, odd), functional.pad(weights, odd)
    total = 4 * functional.avg_pool2d(weights_even, 2)
    coarse = 4 * functional.avg_pool2d(values_even * weights_even, 2) / (total + _EPSILON)
    filled = functional.interpolate(_filled(coarse, total.clamp(max=1.0)), scale_factor=2, mode="bilinear")
    return torch.lerp(filled[:, :, :height, :width], values, weights)
