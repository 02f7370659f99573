# SPDX-License-Identifier: GPL-3.0-or-later
"""Map network: interface of a network that scores pixels, for trainer, weights file and strategy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .frames import SUBPIXELS


@dataclass(frozen=True, eq=False)
class MapBatch:
    """Batch of B crops of rendered frames, h x w pixels each.

    planes: (B, C, h, w), the network's input. pictures: (B, K, h, w), luminance by rays per pixel, in the order of
    SIDES. fine: (B, 4h, 4w), luminance of the pixels' 4 x 4 parts.
    """

    planes: Tensor
    pictures: Tensor
    fine: Tensor

    @property
    def reference(self) -> Tensor:
        """(B, h, w), L32: the mean of each pixel's parts."""
        batch, height, width = self.fine.shape
        parts = self.fine.reshape(batch, height // SUBPIXELS, SUBPIXELS, width // SUBPIXELS, SUBPIXELS)
        return parts.mean(dim=(2, 4))


@dataclass(frozen=True, eq=False)
class MapNetwork:
    """Network that maps the G-buffer of a view to a score per pixel, and its training.

    name: on the command line. strategy, title, description, quantity, maximum: of its strategy. planes: G-buffer (9, H,
    W) to input (C, H, W). build: a new network with random weights. scores: network and input (B, C, H, W) to scores
    (B, H, W), differentiable by torch. loss: network and batch to a number. batch, crop: default crops per step, and
    side of a crop in pixels.
    """

    name: str
    strategy: str
    title: str
    description: str
    quantity: str
    maximum: float
    planes: Callable[[np.ndarray], np.ndarray]
    build: Callable[[], torch.nn.Module]
    scores: Callable[[torch.nn.Module, Tensor], Tensor]
    loss: Callable[[torch.nn.Module, MapBatch], Tensor]
    batch: int
    crop: int
