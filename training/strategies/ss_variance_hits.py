# SPDX-License-Identifier: GPL-3.0-or-later
"""Variance of the 1-sample picture in a 3x3 window, for pixels with a hit only (methods 3.3, 7.24).

Network and look-up table cannot rank pixels without a hit. This screen-space variance has the same limitation, which
shows the value of such pixels.
"""

import numpy as np

from ...patchnet_addon.sampling import ss_variance
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import Strategy


def _score(buffers: PixelBuffers) -> np.ndarray:
    return np.where(buffers.hit, ss_variance.STRATEGY.score(buffers), 0.0)


STRATEGIES = (
    Strategy(
        name="ss-variance-hits",
        title="Screen-space variance of hits",
        description="Variance of luminance in the 3x3 pixels around; 0 in pixels without a hit",
        needs=frozenset(),
        score=_score,
        quantity="variance of luminance",
        maximum=0.05,
        group="screen-space",
    ),
)
