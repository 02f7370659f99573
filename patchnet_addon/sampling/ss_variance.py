# SPDX-License-Identifier: GPL-3.0-or-later
"""Variance of the 1-sample picture in a 3x3 window: what the screen alone can tell (methods 3.3)."""

import numpy as np

from .pixel_buffers import PixelBuffers
from .strategy import Strategy
from .windows import windows


def _score(buffers: PixelBuffers) -> np.ndarray:
    values, inside = windows(buffers.picture(buffers.shown.astype(np.float64)))
    count = inside.sum(axis=-1)  # 9, fewer at the picture's borders
    mean = values.sum(axis=-1) / count
    deviation = np.where(inside, values - mean[..., None], 0.0)
    return ((deviation**2).sum(axis=-1) / count).ravel()


STRATEGY = Strategy(
    name="ss-variance",
    title="Screen-space variance",
    description="Variance of luminance in the 3x3 pixels around: no look-ahead, only the picture itself",
    needs=frozenset(),
    score=_score,
    quantity="variance of luminance",
    maximum=0.05,
    group="screen-space",
)
