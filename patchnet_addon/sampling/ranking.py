# SPDX-License-Identifier: GPL-3.0-or-later
"""Ranking of a view's pixels by a strategy, and the pixels that a budget refines (methods 3, 7.25)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .errors import left_after
from .pixel_buffers import PixelBuffers
from .refine import priority, refinable, refined_count, refined_mask, refinement_order
from .sample_counts import LITTLE, refined_counts, sample_counts
from .strategy import Strategy


@dataclass(frozen=True, eq=False)
class Ranking:
    """Pixels of a view in the order of a strategy, scored and sorted once.

    score: (P,) float32. priority: (P,) scores times importance. order: (A,) int64 indices of the active pixels, first
    refined first. budget: share of them, 0 to 1. mask: (P,) bool, pixels refined by the budget.
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

        Pixels of score 0 stay 0, even within the budget.
        """
        amount = np.zeros(len(self.score), np.float32)
        amount[self.order[:count]] = 1.0 - np.arange(count, dtype=np.float32) / max(count, 1)
        return np.where(self.priority > 0, amount, np.float32(0.0))

    def samples(self, mean: float) -> np.ndarray:
        """(P,) int32: samples of each pixel where `mean`, over the active ones, is spread by priority (methods 7.25b).

        Pixels of importance 0 and inactive pixels get one. A score of 0 counts as a tiny priority: without look-ahead
        it means "unknown", and such pixels may hold a third of all error. Raises SettingError for a mean outside 1 to
        1024.
        """
        ranked, matter = self.priority[self.order].astype(np.float64), refinable(self.buffers)
        ranked[:matter], ranked[matter:] = np.maximum(ranked[:matter], LITTLE), 0.0
        samples = np.ones(len(self.score), np.int32)
        samples[self.order] = sample_counts(ranked, mean, predicted=self.buffers.shows_predicted)
        return samples

    def refined_samples(self, mean: float, budget: float | None = None) -> np.ndarray:
        """(P,) int32: samples of each pixel; those of `mask` have `mean` on average, by priority (methods 7.25b).

        All others have one. budget: overrides the ranking's. Raises SettingError for a mean outside 16 to 1024.
        """
        refined = self.order[: refined_count(self.buffers, self.budget if budget is None else budget, len(self.order))]
        urgent = np.maximum(self.priority[refined].astype(np.float64), LITTLE)
        samples = np.ones(len(self.score), np.int32)
        samples[refined] = refined_counts(urgent, mean, predicted=self.buffers.shows_predicted)
        return samples

    def chosen(self, first: np.ndarray, budget: float) -> np.ndarray:
        """(P,) bool: pixels that an expensive renderer samples, a budget's share of all P, rounded down.

        first: (P,) bool, pixels chosen before all others. Both groups go by falling priority; inactive pixels come
        last; pixels of importance 0 are chosen only if in `first`.
        """
        before = np.flatnonzero(first)
        before = before[np.argsort(-self.priority[before], kind="stable")]
        buffers = self.buffers
        matter = True if buffers.importance is None else buffers.importance > 0
        after = np.concatenate([self.order[: refinable(buffers)], np.flatnonzero(~buffers.active & matter)])
        mask = np.zeros(len(first), bool)
        mask[np.concatenate([before, after[~first[after]]])[: int(budget * len(first) + 1e-9)]] = True
        return mask

    @property
    def mse(self) -> tuple[float, float]:
        """Mean squared error over active pixels without refinement, and after the budget. It needs the reference."""
        before, after = left_after(self.buffers, self.order, [0.0, self.budget])
        return float(before), float(after)


def rank(strategy: Strategy, buffers: PixelBuffers, budget: float = 0.0) -> Ranking:
    """Score and sort the pixels of a view; raises SettingError for a view without the strategy's inputs."""
    score = strategy.scores(buffers)
    order = refinement_order(buffers, score)
    mask = refined_mask(buffers, order, budget)
    return Ranking(strategy, buffers, budget, score, priority(buffers, score), order, mask)
