# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer rays instead of a network: what a pixel's centre, or a 2x2 grid in it, shows with a finer footprint.

The plainest rivals of a look-ahead at the same number of rays (methods 10): if the network does not beat them, the ray
that it saves is worth more than it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import FINE, FINE_RAYS, Strategy

Seen = Callable[[PixelBuffers], np.ndarray]


def _strategy(name: str, title: str, words: str, need: str, seen: Seen, rays: int) -> Strategy:
    """Strategy of the difference to what so many finer rays have `seen`, of the part `need` of a view."""
    return Strategy(
        name=name,
        title=title,
        description=f"Luminance difference to {words} one level more than a patch",
        needs=frozenset({need}),
        score=lambda buffers: np.abs(buffers.preview - seen(buffers)),
        quantity="luminance difference",
        maximum=0.5,
        group="rays",
        extra_rays=rays,
    )


def _one(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.fine is not None  # `needs` says so
    return buffers.fine


def _mean_of_four(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.fine_rays is not None
    first, second, third, fourth = buffers.fine_rays.T  # NumPy's mean takes several times as long over so short an axis
    mean: np.ndarray = ((first + second) + (third + fourth)) * np.float32(0.25)
    return mean


FINE_RAY = _strategy("fine-ray", "One finer ray", "one ray through the pixel's center that sees", FINE, _one, 1)
FINE_RAYS_4 = _strategy(
    "fine-rays-4", "Four finer rays", "the mean of 2x2 rays in the pixel that see", FINE_RAYS, _mean_of_four, 4
)

STRATEGIES = FINE_RAY, FINE_RAYS_4
