# SPDX-License-Identifier: GPL-3.0-or-later
"""PN+ strategy: the pixel's error, estimated with the luminance behind the patch (methods 3.12)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .predicted import expected_luminance
from .strategy import BEHIND, EXACT, PREDICTION, Strategy

if TYPE_CHECKING:
    from ..codes.prediction import Prediction

_NEIGHBOURS = ((0, 1), (1, -1), (1, 0), (1, 1))  # offsets of half the neighbours; the pairs are symmetric


def expected_error(buffers: PixelBuffers, patch: Prediction) -> np.ndarray:
    """s = |L_V - (sigma L_N + (1 - sigma) L_B)|, (P,) float32; 0 where the ray misses (methods 7.24).

    The predicted picture, if shown, replaces L_V.
    """
    assert buffers.behind is not None  # guaranteed by `needs`
    seen = expected_luminance(patch, buffers.behind)
    return np.where(buffers.hit, np.abs(buffers.shown - seen), np.float32(0.0))


def _score(buffers: PixelBuffers) -> np.ndarray:
    if buffers.shows_predicted:  # a pixel has no difference to itself
        return remaining_error(buffers)
    assert buffers.prediction is not None  # guaranteed by `needs`
    return expected_error(buffers, buffers.prediction)


def _exact_score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.exact is not None
    return expected_error(buffers, buffers.exact)


def remaining_error(buffers: PixelBuffers) -> np.ndarray:
    """s = sqrt((P - L_F)^2 + mean over 3x3 of (P_j - P)^2), (P,) float32, in units of luminance.

    P: the predicted picture. L_F: luminance of the finer ray; the background where the coarse one misses.
    """
    assert buffers.predicted is not None and buffers.fine is not None  # traced for the predicted picture
    sample = (buffers.predicted - buffers.fine) ** 2
    around = neighbour_difference(buffers.picture(buffers.predicted)).ravel()
    return np.sqrt(np.where(buffers.hit, sample, np.float32(0.0)) + around).astype(np.float32)


def neighbour_difference(picture: np.ndarray) -> np.ndarray:
    """Mean squared difference (H, W) float64 between each pixel of `picture` (H, W) and those of its 3x3 window.

    The pixel itself is included; windows at the picture's borders have fewer than nine pixels.
    """
    height, width = picture.shape
    values = picture.astype(np.float64)
    total, count = np.zeros((height, width)), np.ones((height, width))
    for down, right in _NEIGHBOURS:
        here = slice(0, height - down), slice(max(-right, 0), width - max(right, 0))
        there = slice(down, height), slice(max(right, 0), width - max(-right, 0))
        squared = (values[here] - values[there]) ** 2
        for part in (here, there):
            total[part] += squared
            count[part] += 1
    return np.asarray(total / count)


STRATEGY = Strategy(
    name="patchnet-behind",
    title="PatchNet Behind",
    description="Expected error by the network and one further ray; choose it for weights without an error estimator",
    needs=frozenset({PREDICTION, BEHIND}),
    score=_score,
    quantity="expected luminance error",
    maximum=0.5,
    group="network",
    extra_rays=1,
)

# Coverage and luminance are rendered from the patch: the limit of any network (methods 9).
EXACT_ORACLE = replace(
    STRATEGY,
    name="patchnet-behind-exact",
    title="PatchNet Behind, exact oracle",
    description="PatchNet Behind with exact coverage and luminance; choose it to see the limit of any network",
    needs=frozenset({EXACT, BEHIND}),
    score=_exact_score,
    group="oracle",
    extra_rays=0,
)
