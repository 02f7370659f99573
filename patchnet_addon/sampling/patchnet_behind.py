# SPDX-License-Identifier: GPL-3.0-or-later
"""PN+ strategy: the pixel's error, estimated with the luminance that shows behind the patch (methods 3.12)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .predicted import expected_luminance
from .remaining import remaining_error
from .strategy import BEHIND, PREDICTION, Strategy

if TYPE_CHECKING:
    from ..codes.predict import Prediction


def expected_error(buffers: PixelBuffers, patch: Prediction) -> np.ndarray:
    """s = |L_V - (sigma L_N + (1 - sigma) L_B)|, (P,) float32; 0 where the ray met nothing (methods 7.24).

    Where the predicted picture is shown, it stands in the place of L_V.
    """
    assert buffers.behind is not None  # `needs` says so
    seen = expected_luminance(patch, buffers.behind)
    return np.where(buffers.hit, np.abs(buffers.shown - seen), np.float32(0.0))


def _score(buffers: PixelBuffers) -> np.ndarray:
    if buffers.shows_predicted:  # it has no difference to itself
        return remaining_error(buffers)
    assert buffers.prediction is not None  # `needs` says so
    return expected_error(buffers, buffers.prediction)


STRATEGY = Strategy(
    name="patchnet-behind",
    title="PatchNet Behind",
    description="The luminance error that follows from the patch's coverage, its luminance and what lies behind it",
    needs=frozenset({PREDICTION, BEHIND}),
    score=_score,
    quantity="expected luminance error",
    maximum=0.5,
    group="network",
    extra_rays=1,
)
