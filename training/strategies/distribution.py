# SPDX-License-Identifier: GPL-3.0-or-later
"""Windows of 3x3 pixels, and the distribution p of luminance or of another weight in them (methods 2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import Strategy

EPSILON = 1e-6  # windows with a smaller sum of luminance are black


def windows(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (H, W, 9) of the windows of `picture` (H, W), and a mask (H, W, 9) bool of the values inside the picture.

    Values outside the picture are 0. A window is in row-major order, its pixel at index 4.
    """
    padded = np.pad(picture, 1), np.pad(np.ones(picture.shape, bool), 1)
    values, inside = (sliding_window_view(plane, (3, 3)).reshape(*picture.shape, 9) for plane in padded)
    return values, inside


@dataclass(frozen=True, eq=False)
class WindowDistribution:
    """Distribution p_i = w_i / sum w of weights over the N pixels of each window inside the picture.

    inside: (H, W, 9) bool, pixels in the picture. count: (H, W), N, their number. mean: (H, W) float64, mean weight.
    ratio: (H, W, 9) float64, N p_i, the weights over their mean; 1 in windows without weight, which count as uniform,
    and 0 outside the picture.

    Contrasts are sums over these ratios instead of p_i: in uniform windows they are exactly 1, so that all uniform
    windows score exactly 0 and tie for any N.
    """

    inside: np.ndarray
    count: np.ndarray
    mean: np.ndarray
    ratio: np.ndarray

    @classmethod
    def of(cls, weights: np.ndarray, least: float) -> WindowDistribution:
        """Distributions in a picture of weights (H, W) >= 0; windows whose sum is below `least` count as uniform."""
        values, inside = windows(weights.astype(np.float64))
        count = inside.sum(axis=-1)  # 9, fewer at the picture's borders
        total = values.sum(axis=-1)
        mean = total / count
        there = total >= least
        ratio = np.where(there[..., None], values / np.where(there, mean, 1.0)[..., None], 1.0)
        return cls(inside, count, mean, np.where(inside, ratio, 0.0))

    def average(self, values: np.ndarray) -> np.ndarray:
        """Mean (H, W) of values (H, W, 9) over the window's pixels in the picture."""
        return np.where(self.inside, values, 0.0).sum(axis=-1) / self.count


Contrast = Callable[[WindowDistribution], np.ndarray]
"""Contrast (H, W) of the distribution in each window."""


def luminance_contrast(buffers: PixelBuffers, contrast: Contrast) -> np.ndarray:
    """Contrast times mean luminance of each window of the preview, (H, W); black windows count as uniform."""
    distribution = WindowDistribution.of(buffers.picture(buffers.preview), EPSILON)
    return distribution.mean * contrast(distribution)


def contrast_strategy(
    name: str, title: str, description: str, contrast: Contrast, maximum: float, quantity: str = "luminance x contrast"
) -> Strategy:
    """Strategy whose score is a contrast of luminance times mean luminance of the 3x3 pixels around each pixel."""
    return Strategy(
        name=name,
        title=title,
        description=description,
        needs=frozenset(),
        score=lambda buffers: luminance_contrast(buffers, contrast).ravel(),
        quantity=quantity,
        maximum=maximum,
        group="screen-space",
    )
