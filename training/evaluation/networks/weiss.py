# SPDX-License-Identifier: GPL-3.0-or-later
"""WITW20: importance network of Weiss, Isik, Thies and Westermann, retrained (methods 3.9).

"Learning Adaptive Sampling and Reconstruction for Volume Visualization", 2020. As in the paper: the network, its input
and padding, softplus, normalisation of the map to a mean, smooth sampling against a low-discrepancy pattern, pull-push
inpainting, the loss on the map's mean, Adam at 1e-4 in batches of 16. Different: the picture is only inpainted
luminance, without the reconstruction network, and the loss its L1 distance; the pattern of thresholds uses the plastic
number; training uses crops. The planes of the previous frame are omitted: without temporal coherence they are 0, and
their 2,880 weights unused.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from .frames import DISTANCE, MASK, SUBPIXELS
from .map_network import MapBatch, MapNetwork

_EPSILON = 1e-6
_INPUTS, _FEATURES, _BLOCKS = 5, 64, 5
_BORDER = 8  # pixels of zeros around the input
_LEAST, _MEAN = 0.01, 0.2  # of the normalised map: samples of each of the 4 x 4 parts of a pixel
_SHARPNESS = 50.0
_MEAN_WEIGHT, _WANTED_MEAN = 0.1, 0.5
_PLASTIC = 1.324717957244746


def pull_push(values: Tensor, weights: Tensor) -> Tensor:
    """Fill pictures (B, H, W) where their weights (B, H, W), in [0, 1], are small; gradients reach the weights.

    Gortler, Grzeszczuk, Szeliski, Cohen, "The Lumigraph", 1996. Pull: each coarser pixel is the weighted mean of 2 x 2,
    with the sum of their weights, at most 1. Push: what a weight leaves of a pixel is filled from the coarser picture.
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


class _Block(nn.Module):
    """Residual block of two convolutions."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Conv2d(_FEATURES, _FEATURES, 3, padding=1)
        self.second = nn.Conv2d(_FEATURES, _FEATURES, 3, padding=1)

    def forward(self, values: Tensor) -> Tensor:
        """(B, 64, H, W) of the same."""
        return values + self.second(functional.relu(self.first(values)))


class WeissNet(nn.Module):
    """Importance network in the manner of EnhanceNet: 483,585 weights."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Conv2d(_INPUTS, _FEATURES, 3, padding=1)
        self.blocks = nn.Sequential(*(_Block() for _ in range(_BLOCKS)))
        self.upsampling = nn.ModuleList(nn.Conv2d(_FEATURES, _FEATURES, 3, padding=1) for _ in range(2))
        self.last = nn.Conv2d(_FEATURES, _FEATURES, 3, padding=1)
        self.output = nn.Conv2d(_FEATURES, 1, 3, padding=1)

    def forward(self, planes: Tensor) -> Tensor:
        """Importance (B, 4H, 4W), positive, of planes (B, 5, H, W)."""
        values = self.blocks(functional.relu(self.first(functional.pad(planes, [_BORDER] * 4))))
        for convolution in self.upsampling:
            values = functional.interpolate(values, scale_factor=2, mode="bilinear")
            values = functional.relu(convolution(values))
        values = functional.softplus(self.output(functional.relu(self.last(values))))
        border = SUBPIXELS * _BORDER
        return values[:, 0, border:-border, border:-border]


def normalised(importance: Tensor) -> Tensor:
    """Map (B, h, w) as shares of samples: at least 0.01, 0.2 in the mean of each picture."""
    mean = importance.mean(dim=(1, 2), keepdim=True).clamp(min=1e-8)
    return _LEAST + importance.clamp(min=0) * (_MEAN - _LEAST) / mean


def pattern(height: int, width: int) -> Tensor:
    """Evenly distributed thresholds (height, width) in [0, 1): additive recurrence of the plastic number."""
    rows, columns = torch.arange(height, dtype=torch.float64), torch.arange(width, dtype=torch.float64)
    return ((rows[:, None] / _PLASTIC**2 + columns / _PLASTIC) % 1.0).float()


def _scores(network: nn.Module, planes: Tensor) -> Tensor:
    """Sums over 4 x 4 of the map."""
    parts = functional.avg_pool2d(network(planes)[:, None], SUBPIXELS)
    return SUBPIXELS**2 * parts[:, 0]


def _loss(network: nn.Module, batch: MapBatch) -> Tensor:
    """L1 distance of the inpainted picture, plus the distance of the map's mean from 0.5."""
    importance = network(batch.planes)
    thresholds = pattern(*importance.shape[1:]).to(importance.device)
    samples = torch.sigmoid(_SHARPNESS * (normalised(importance) - thresholds))
    picture = pull_push(batch.fine, samples)
    off = (_WANTED_MEAN - importance.mean(dim=(1, 2))) ** 2
    return (picture - batch.fine).abs().mean() + _MEAN_WEIGHT * off.mean()


WEISS = MapNetwork(
    name="weiss",
    strategy="witw20",
    title="Importance network (WITW20)",
    description="Importance network on mask, normal and depth, trained through inpainted samples",
    quantity="importance",
    maximum=16.0,
    planes=lambda planes: planes[MASK : DISTANCE + 1],  # mask, normal, distance
    build=WeissNet,
    scores=_scores,
    loss=_loss,
    batch=16,
    crop=32,
)
