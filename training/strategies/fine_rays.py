# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer rays instead of a network, and fusions of an expected luminance error with screen-space variance (methods 10).

Finer rays, a pixel's centre ray or a 2x2 grid of rays with a finer footprint, are the simplest rivals of a look-ahead
with the same number of rays: a network has to beat them to be worth its cost. A fusion is s^2 = e^2 + variance / 4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...patchnet_addon.sampling import patchnet_behind, ss_variance
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import FINE, FINE_RAYS, Strategy

SHARE = 0.25  # share of the variance of 3x3 pixels that estimates the pixel's own
Seen = Callable[[PixelBuffers], np.ndarray]


def _strategy(name: str, title: str, words: str, need: str, seen: Seen, rays: int) -> Strategy:
    """Strategy by the difference to the luminance `seen` of so many finer rays, of the part `need` of a view."""
    return Strategy(
        name=name,
        title=title,
        description=f"Luminance difference to {words}, one level finer than a patch",
        needs=frozenset({need}),
        score=lambda buffers: np.abs(buffers.preview - seen(buffers)),
        quantity="luminance difference",
        maximum=0.5,
        group="rays",
        extra_rays=rays,
    )


def _one(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.fine is not None  # required by `needs`
    return buffers.fine


def _mean_of_four(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.fine_rays is not None
    first, second, third, fourth = buffers.fine_rays.T  # faster than NumPy's mean over a short axis
    return ((first + second) + (third + fourth)) * np.float32(0.25)


def _with_variance(strategy: Strategy, name: str, title: str) -> Strategy:
    """Strategy that adds SS-Variance to a strategy whose score is a luminance difference."""

    def score(buffers: PixelBuffers) -> np.ndarray:
        expected = np.asarray(strategy.score(buffers), np.float64)
        return np.sqrt(expected**2 + SHARE * ss_variance.STRATEGY.score(buffers))

    description = f"{strategy.title}, and the variance of luminance in the 3x3 pixels around"
    quantity = "expected luminance error"
    return replace(strategy, name=name, title=title, description=description, score=score, quantity=quantity)


_FINE_RAY = _strategy("fine-ray", "One finer ray", "one ray through the pixel's center", FINE, _one, 1)
_FINE_RAYS_4 = _strategy(
    "fine-rays-4", "Four finer rays", "the mean of 2x2 rays in the pixel", FINE_RAYS, _mean_of_four, 4
)
STRATEGIES = (
    _with_variance(patchnet_behind.STRATEGY, "fusion", "PatchNet Behind and variance"),
    _with_variance(_FINE_RAY, "fine-ray-variance", "One finer ray and variance"),
    _with_variance(_FINE_RAYS_4, "fine-rays-4-variance", "Four finer rays and variance"),
    _FINE_RAY,
    _FINE_RAYS_4,
)
