# SPDX-License-Identifier: GPL-3.0-or-later
"""SS-UNet: U-Net that predicts the pixel's error from all screen-space features (methods 3.11).

Not from a paper: added for fairness, as the strongest trained rival without further rays. The U-Net is that of KKR18
(methods 3.10); the loss is the squared difference to |L1 - L32|.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from .frames import MASK, PLANES
from .map_network import MapBatch, MapNetwork

_WIDTHS = (32, 43, 57, 76, 101)
_LAST = (128, 64)
_SLOPE = 0.1  # of LeakyReLU
MULTIPLE = 2 ** len(_WIDTHS)  # of pictures' sides, in pixels
INPUTS = len(PLANES) - 1  # all but the mask


class _Pair(nn.Module):
    """Two convolutions 3 x 3 with LeakyReLU."""

    def __init__(self, before: int, middle: int, after: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(before, middle, 3, padding=1)
        self.second = nn.Conv2d(middle, after, 3, padding=1)

    def forward(self, values: Tensor) -> Tensor:
        """(B, after, H, W) of (B, before, H, W)."""
        values = functional.leaky_relu(self.first(values), _SLOPE)
        return functional.leaky_relu(self.second(values), _SLOPE)


class UNet(nn.Module):
    """U-Net of Kuznetsov, Kalantari and Ramamoorthi with one output: 1,069,765 weights for 11 inputs."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        before = (inputs, *_WIDTHS[:-1])
        self.encoder = nn.ModuleList(_Pair(a, b, b) for a, b in zip(before, _WIDTHS, strict=True))
        self.middle = _Pair(_WIDTHS[-1], _WIDTHS[-1], _WIDTHS[-1])
        # Both concatenated inputs have the same number of features.
        after = [(width, width) for width in _WIDTHS[-2::-1]] + [_LAST]
        self.decoder = nn.ModuleList(_Pair(2 * width, *pair) for width, pair in zip(_WIDTHS[::-1], after, strict=True))
        self.output = nn.Conv2d(_LAST[-1], 1, 3, padding=1)

    def forward(self, planes: Tensor) -> Tensor:
        """Output (B, H, W) of planes (B, C, H, W), which are padded with zeros to a multiple of 32."""
        height, width = planes.shape[2:]
        values = functional.pad(planes, [0, -width % MULTIPLE, 0, -height % MULTIPLE])
        skips = []
        for pair in self.encoder:
            skips.append(pair(values))
            values = functional.max_pool2d(skips[-1], 2)
        values = self.middle(values)
        for pair, skip in zip(self.decoder, reversed(skips), strict=True):
            values = pair(torch.cat([functional.interpolate(values, scale_factor=2, mode="nearest"), skip], dim=1))
        return self.output(values)[:, 0, :height, :width]


def _loss(network: nn.Module, batch: MapBatch) -> Tensor:
    return functional.mse_loss(network(batch.planes), (batch.pictures[:, 0] - batch.reference).abs())


UNET = MapNetwork(
    name="unet",
    strategy="ss-unet",
    title="Screen-space U-Net",
    description="U-Net that predicts |L1 - L32| from luminance, depth, normal, level, ratio and number of children",
    quantity="luminance difference",
    maximum=0.5,
    planes=lambda planes: np.delete(planes, MASK, axis=0),
    build=lambda: UNet(INPUTS),
    scores=lambda network, planes: network(planes),
    loss=_loss,
    batch=6,
    crop=96,
)
