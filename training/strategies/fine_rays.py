# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer rays instead of a network: what a pixel's centre, or a 2x2 grid in it, shows with a finer footprint.

The plainest rivals of a look-ahead at the same number of rays (methods 10): if the network does not beat them, the ray
that it saves is worth more than it.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import FINE, FINE_RAYS, Strategy

_QUANTITY = "luminance difference"


def _score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.fine is not None  # `needs` says so
    return np.abs(buffers.preview - buffers.fine)


def _score_4(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.fine_rays is not None
    first, second, third, fourth = buffers.fine_rays.T  # NumPy's mean takes several times as long over so short an axis
    return np.abs(buffers.preview - ((first + second) + (third + fourth)) * np.float32(0.25))


FINE_RAY = Strategy(
    name="fine-ray",
    title="One finer ray",
    description="Luminance difference to one ray through the pixel's center that sees one level more than a patch",
    needs=frozenset({FINE}),
    score=_score,
    quantity=_QUANTITY,
    maximum=0.5,
    group="rays",
    extra_rays=1,
)

FINE_RAYS_4 = Strategy(
    name="fine-rays-4",
    title="Four finer rays",
    description="Luminance difference to the mean of 2x2 rays in the pixel that see one level more than a patch",
    needs=frozenset({FINE_RAYS}),
    score=_score_4,
    quantity=_QUANTITY,
    maximum=0.5,
    group="rays",
    extra_rays=4,
)

STRATEGIES = FINE_RAY, FINE_RAYS_4
