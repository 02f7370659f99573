# SPDX-License-Identifier: GPL-3.0-or-later
"""Ranking in stages: one finer ray for all pixels, then closer looks at those that are near the budget's cut.

What a pixel's score costs has to be worth it. A finer ray tells already which pixels are surely refined within a
budget, and which surely are not. Only those between get the ray behind their patch, the network, four more rays
(methods 12.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .plus.forms import Form
from .refine import priority, refined_count
from .staged_looks import Looks
from .staged_pixels import KnownPixels

if TYPE_CHECKING:
    from .plus.weights import Estimators

VARIANCE_SHARE = 1 / 16
"""Share of the variance of 3x3 pixels beside the finer ray's squared difference in the first score."""
_BESIDE = 1e-6  # relative distance from the cut of scores that have to be above or below it


@dataclass(frozen=True)
class Stage:
    """Stage of a ranking.

    form: of the estimator that scores the pixels that take part. sure, reached: they are those whose place by the
    scores before is between sure and reached times the number of pixels that the budget refines. Those before are
    refined.
    """

    form: Form
    sure: float
    reached: float


def staged_scores(
    buffers: PixelBuffers, looks: Looks, stages: Sequence[Stage], budget: float, estimators: Estimators
) -> np.ndarray:
    """Scores (P,) float32 of the preview's pixels, by which a share `budget` of the active ones is refined.

    Pixels that the last stage looked at have the error that they are expected to have. All others have the score of an
    earlier one, and are above or below the cut as that has decided: only the order about the cut decides what a budget
    leaves. buffers: hits, the finer ray, and importance. Raises SettingError for a budget outside 0 to 1.
    """
    pool = np.flatnonzero(buffers.active)
    refined = refined_count(buffers, budget, len(pool))
    score = first_scores(buffers)
    known = KnownPixels(buffers, looks)
    sure = pool[:0]
    for stage in stages:
        last = len(pool) if math.isinf(stage.reached) else math.ceil(stage.reached * refined) - len(sure)
        first = math.floor(stage.sure * refined) - len(sure)
        urgency = priority(buffers, score)
        above, pool = _split(_split(pool, urgency, last)[0], urgency, first)
        sure = np.concatenate([sure, above])
        if not len(pool):
            break
        score[pool] = known.estimate(stage.form, pool, estimators)
    _keep_apart(score, priority(buffers, score), sure, pool, refined)
    return score


def first_scores(buffers: PixelBuffers) -> np.ndarray:
    """Scores (P,) float32 of all active pixels: difference to the finer ray, and variance of the window."""
    from .window_variance import window_variance  # compiled code, which registration must not load

    assert buffers.fine is not None
    difference = buffers.preview - buffers.fine
    variance = window_variance(buffers.picture(buffers.preview)).ravel()
    score = np.sqrt(difference * difference + np.float32(VARIANCE_SHARE) * variance.astype(np.float32))
    return np.where(buffers.active, score, np.float32(0.0))


def _split(pixels: np.ndarray, urgency: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The `count` of pixels (N,) whose urgency (P,) is highest, and the others, both in rising order."""
    if count >= len(pixels):
        return pixels, pixels[:0]
    if count <= 0:
        return pixels[:0], pixels
    order = np.argpartition(-urgency[pixels], count - 1)
    return np.sort(pixels[order[:count]]), np.sort(pixels[order[count:]])


def _keep_apart(score: np.ndarray, urgency: np.ndarray, sure: np.ndarray, pool: np.ndarray, refined: int) -> None:
    """Change scores (P,) so that the budget refines the pixels `sure`, and of all others only some of the `pool`.

    urgency: (P,) scores times importance.
    """
    left = refined - len(sure)
    if not 0 < left <= len(pool):
        return
    cut = np.partition(urgency[pool], len(pool) - left)[len(pool) - left]
    others = np.ones(len(score), bool)
    others[sure] = others[pool] = False
    high = np.flatnonzero(others & (urgency >= cut))
    low = sure[urgency[sure] <= cut]
    tiny = np.finfo(np.float32).tiny
    score[high] *= np.float32(1.0 - _BESIDE) * cut / np.maximum(urgency[high], tiny)
    score[low] *= np.float32(1.0 + _BESIDE) * cut / np.maximum(urgency[low], tiny)
