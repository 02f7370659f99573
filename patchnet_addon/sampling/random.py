# SPDX-License-Identifier: GPL-3.0-or-later
"""Random strategy: pixels in a fixed pseudo-random order, the baseline of all measurements (methods 3.2)."""

import numpy as np

from .pixel_buffers import PixelBuffers
from .refine import pixel_hash
from .strategy import Strategy


def _score(buffers: PixelBuffers) -> np.ndarray:
    # 24 bits: exact in float32, so that rounding makes no two hashes equal.
    return (pixel_hash(buffers.height * buffers.width) >> np.uint64(40)).astype(np.float64) * 2.0**-24


STRATEGY = Strategy(
    name="random",
    title="Random",
    description="Refines pixels in random order; choose it as the baseline of other strategies",
    needs=frozenset(),
    score=_score,
    quantity="chance",
    maximum=1.0,
    group="screen-space",
)
