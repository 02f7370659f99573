# SPDX-License-Identifier: GPL-3.0-or-later
"""PN+ strategy: the pixel's error, estimated with the luminance that shows behind the patch (methods 3.12)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .strategy import BEHIND, PREDICTION, Strategy

if TYPE_CHECKING:
    from ..codes.predict import Prediction


def expected_error(buffers: PixelBuffers, patch: Prediction) -> np.ndarray:
    """s = |L_V - (sigma L_N + (1 - sigma) L_B)|, (P,) float32; 0 where the ray met nothing (methods 7.24)."""
    assert buffers.behind is not None  # `needs` says so
    seen = patch.coverage * patch.luminance + (1.0 - patch.coverage) * buffers.behind
    return np.where(buffers.hit, np.abs(buffers.preview - seen), np.float32(0.0))


def _score(buffers: PixelBuffers) -> np.ndarray:
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
