# SPDX-License-Identifier: GPL-3.0-or-later
"""Ranking of a view's pixels by a strategy, and what a budget refines of them (methods 3, 7.25)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .errors import left_after
from .pixel_buffers import PixelBuffers
from .refine import priority, refined_mask, refinement_order
from .sample_counts import refined_in_order, samples_in_order
from .staged_looks import KnownLooks
from .staged_strategy import StagedStrategy
from .strategy import Strategy


@dataclass(frozen=True, eq=False)
class Ranking:
    """Pixels of a view in the order of a strategy, scored and sorted once.

    score: (P,) float32. priority: (P,) scores times importance. order: (A,) int64 indices of the active pixels, first
    refined first. budget: share of them, 0 to 1. mask: (P,) bool, those that the budget refines.
    """

    strategy: Strategy
    buffers: PixelBuffers
    budget: float
    score: np.ndarray
    priority: np.ndarray
    order: np.ndarray
    mask: np.ndarray

    def urgency(self, count: int) -> np.ndarray:
        """(P,) float32: 1 for the pixel that is refined first, falling to 0 after `count` pixels, 0 beyond them.

        Pixels of score 0 stay 0: nothing is known to be wrong there, though the budget may reach them.
        """
        amount = np.zeros(len(self.score), np.float32)
        amount[self.order[:count]] = 1.0 - np.arange(count, dtype=np.float32) / max(count, 1)
        return np.where(self.priority > 0, amount, np.float32(0.0))

    def samples(self, mean: float) -> np.ndarray:
        """(P,) int32: samples of each pixel where `mean`, over the active ones, is spread by priority (methods 7.25b).

        Pixels of importance 0, and those that are not active, have one. Raises SettingError for a mean outside 1 to
        1024.
        """
        counts = np.ones(len(self.score), np.int32)
        counts[self.order] = samples_in_order(self.buffers, self.priority, self.order, mean)
        return counts

    def refined_samples(self, mean: float) -> np.ndarray:
        """(P,) int32: samples of each pixel where those of `mask` have `mean` on average, by priority (methods 7.25b).

        All others have one. Raises SettingError for a mean outside 16 to 1024.
        """
        counts = np.ones(len(self.score), np.int32)
        counts[self.order] = refined_in_order(self.buffers, self.priority, self.order, self.budget, mean)
        return counts

    @property
    def mse(self) -> tuple[float, float]:
        """Mean squared error over active pixels without refinement, and after the budget. It needs the reference."""
        before, after = left_after(self.buffers, self.order, [0.0, self.budget])
        return float(before), float(after)


def rank(strategy: Strategy, buffers: PixelBuffers, budget: float) -> Ranking:
    """Score and sort the pixels of a view. Raises SettingError for a budget outside 0 to 1, or a view that lacks
    what the strategy reads."""
    if isinstance(strategy, StagedStrategy) and not buffers.shows_predicted:  # stages are of the preview's errors
        strategy.check(buffers)
        score = strategy.scores_within(buffers, KnownLooks(buffers), budget)
    else:
        score = strategy.scores(buffers)
    order = refinement_order(buffers, score)
    mask = refined_mask(buffers, order, budget)
    return Ranking(strategy, buffers, budget, score, priority(buffers, score), order, mask)
