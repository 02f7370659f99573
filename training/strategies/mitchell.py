# SPDX-License-Identifier: GPL-3.0-or-later
"""Mitchell's contrast of luminance in a 3x3 window (methods 3.4)."""

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import Strategy
from .distribution import EPSILON, windows


def _score(buffers: PixelBuffers) -> np.ndarray:
    values, inside = windows(buffers.picture(buffers.preview.astype(np.float64)))
    most = np.where(inside, values, -np.inf).max(axis=-1)
    least = np.where(inside, values, np.inf).min(axis=-1)
    total = most + least
    return np.where(total < EPSILON, 0.0, (most - least) / np.maximum(total, EPSILON)).ravel()


STRATEGIES = (
    Strategy(
        name="mitchell",
        title="Mitchell contrast",
        description="Contrast of luminance, (most - least) / (most + least), in the 3x3 pixels around",
        needs=frozenset(),
        score=_score,
        quantity="contrast",
        maximum=1.0,
        group="screen-space",
    ),
)
