# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet strategy, the paper's score: missing coverage plus weighted luminance error of the patch (methods 3.12)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .strategy import EXACT, PREDICTION, Strategy

if TYPE_CHECKING:
    from ..codes.prediction import Prediction

LUMINANCE_WEIGHT = 5.0  # lambda of the paper


def coverage_and_luminance_score(buffers: PixelBuffers, patch: Prediction) -> np.ndarray:
    """s = |1 - sigma| + lambda |L_V - L_N|, (P,) float32; 0 where the ray misses (methods 7.24)."""
    score = np.abs(1.0 - patch.coverage) + LUMINANCE_WEIGHT * np.abs(buffers.preview - patch.luminance)
    return np.where(buffers.hit, score, np.float32(0.0))


def _score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.prediction is not None  # guaranteed by `needs`
    return coverage_and_luminance_score(buffers, buffers.prediction)


def _exact_score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.exact is not None
    return coverage_and_luminance_score(buffers, buffers.exact)


STRATEGY = Strategy(
    name="patchnet",
    title="PatchNet (paper)",
    description="Missing coverage plus five times the luminance error by the network; choose it to reproduce the paper",
    needs=frozenset({PREDICTION}),
    score=_score,
    quantity="coverage + 5 x luminance",
    maximum=2.0,
    group="network",
)

# Coverage and luminance are rendered from the patch: the limit of any network (methods 9).
EXACT_ORACLE = replace(
    STRATEGY,
    name="patchnet-exact",
    title="PatchNet (paper), exact oracle",
    description="The paper's score with exact coverage and luminance; choose it to see the limit of any network",
    needs=frozenset({EXACT}),
    score=_exact_score,
    group="oracle",
)
