# SPDX-License-Identifier: GPL-3.0-or-later
"""Variance of the 1-sample picture in a 3x3 window: the screen-space strategy (methods 3.3)."""

import numpy as np

from .pixel_buffers import PixelBuffers
from .strategy import Strategy


def _score(buffers: PixelBuffers) -> np.ndarray:
    from .window_variance import window_variance  # compiled code, which registration must not load

    return window_variance(buffers.picture(buffers.shown)).ravel()


STRATEGY = Strategy(
    name="ss-variance",
    title="Screen-space variance",
    description="Luminance variance of the 3x3 pixels around; choose it to see what the network gains",
    needs=frozenset(),
    score=_score,
    quantity="variance of luminance",
    maximum=0.05,
    group="screen-space",
)
