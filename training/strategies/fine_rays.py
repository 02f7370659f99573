# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer rays instead of a network: a pixel's centre ray, or a 2x2 grid of rays, with a finer footprint.

The simplest rivals of a look-ahead with the same number of rays (methods 10): a network has to beat them to be worth
its cost.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import FINE, FINE_RAYS, Strategy

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
    mean: np.ndarray = ((first + second) + (third + fourth)) * np.float32(0.25)
    return mean


FINE_RAY = _strategy("fine-ray", "One finer ray", "one ray through the pixel's center", FINE, _one, 1)
FINE_RAYS_4 = _strategy(
    "fine-rays-4", "Four finer rays", "the mean of 2x2 rays in the pixel", FINE_RAYS, _mean_of_four, 4
)

STRATEGIES = FINE_RAY, FINE_RAYS_4
