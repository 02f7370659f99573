# SPDX-License-Identifier: GPL-3.0-or-later
"""Optimal strategy, by the true error: the limit of all others (methods 3.1); it needs the reference picture."""

import numpy as np

from .pixel_buffers import PixelBuffers
from .strategy import REFERENCE, Strategy


def _score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.reference is not None  # guaranteed by `needs`
    return np.abs(buffers.shown - buffers.reference)


STRATEGY = Strategy(
    name="optimal",
    title="Optimal",
    description="Ranks by the true error against the reference; choose it to see the limit of every strategy",
    needs=frozenset({REFERENCE}),
    score=_score,
    quantity="luminance error",
    maximum=0.5,
    group="oracle",
)
