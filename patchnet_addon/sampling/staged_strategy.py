# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies that rank in stages within a budget (methods 12.5)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from .pixel_buffers import PixelBuffers
from .plus.forms import Form
from .refine import priority, refined_count
from .staged_pixels import KnownPixels, Looks
from .strategy import FINE, Strategy

if TYPE_CHECKING:
    from .plus.weights import Estimators

SUFFIX = "-staged"  # of names

VARIANCE_SHARE = 1 / 16
"""Share of the variance of 3x3 pixels beside the finer ray's squared difference in the first score."""
_TINY = np.finfo(np.float32).tiny
_BESIDE = 1e-6  # relative distance from the cut of scores moved above or below it


@dataclass(frozen=True)
class Stage:
    """Stage of a ranking.

    form: of the estimator that scores the pixels that take part. sure, reached: bounds of their rank by the previous
    scores, over the number of pixels that the budget refines. Pixels before `sure` are refined.
    """

    form: Form
    sure: float
    reached: float


@dataclass(frozen=True)
class Plan:
    """Plan of a ranking.

    stages: those after the first score, by one finer ray per pixel. around: the first score includes a share of the
    window's variance.
    """

    stages: tuple[Stage, ...]
    around: bool = True


def staged_scores(
    buffers: PixelBuffers, looks: Looks | None, plan: Plan, budget: float, estimators: Estimators
) -> np.ndarray:
    """Scores (P,) float32 of the preview's pixels, by which a share `budget` of the active ones is refined.

    Pixels of the last stage have their expected error. All others keep the score of an earlier stage, above or below
    the cut: only the order about the cut affects the error. buffers: hits, the first finer ray, importance, and the
    inputs of `KnownPixels`. looks: None if these suffice. Raises SettingError for a budget outside 0 to 1.
    """
    pool = np.flatnonzero(buffers.active)
    refined = refined_count(buffers, budget, len(pool))
    score = first_scores(buffers, around=plan.around)
    known = KnownPixels(buffers, looks)
    sure = pool[:0]
    for stage in plan.stages:
        last = len(pool) if math.isinf(stage.reached) else math.ceil(stage.reached * refined) - len(sure)
        first = math.floor(stage.sure * refined) - len(sure)
        above, pool = _between(pool, priority(buffers, score), first, last)
        sure = np.concatenate([sure, above])
        if not len(pool):
            break
        score[pool] = known.estimate(stage.form, pool, estimators)
    _keep_apart(score, priority(buffers, score), sure, pool, refined)
    return score


def first_scores(buffers: PixelBuffers, *, around: bool = True) -> np.ndarray:
    """Scores (P,) float32 of all active pixels by their finer ray's difference.

    Includes a share of the window's variance if `around`.
    """
    from .window_variance import window_variance  # compiled code, which registration must not load

    assert buffers.fine is not None
    difference = buffers.preview - buffers.fine
    if not around:
        return np.where(buffers.active, np.abs(difference), np.float32(0.0))
    variance = window_variance(buffers.picture(buffers.preview)).ravel().astype(np.float32)
    variance *= np.float32(VARIANCE_SHARE)
    squared = np.multiply(difference, difference, out=difference)
    squared += variance
    score: np.ndarray = np.sqrt(squared, out=squared)
    score *= buffers.active
    return score


def _between(pixels: np.ndarray, urgency: np.ndarray, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """Split pixels (N,) by falling urgency (P,): the `first`, and those up to the `last`, each in rising order."""
    last = min(max(last, 0), len(pixels))
    first = min(max(first, 0), last)
    cuts = [cut for cut in (first, last) if 0 < cut < len(pixels)]
    if cuts:
        pixels = pixels[np.argpartition(-urgency[pixels], cuts)]
    return pixels[:first], np.sort(pixels[first:last])


def _keep_apart(score: np.ndarray, urgency: np.ndarray, sure: np.ndarray, pool: np.ndarray, refined: int) -> None:
    """Change scores (P,) so that the budget refines the pixels `sure`, and otherwise only pixels of the `pool`.

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
    score[high] *= np.float32(1.0 - _BESIDE) * cut / np.maximum(urgency[high], _TINY)
    score[low] *= np.float32(1.0 + _BESIDE) * cut / np.maximum(urgency[low], _TINY)


@dataclass(frozen=True)
class StagedStrategy(Strategy):
    """Strategy of the error estimator that ranks in stages within a budget.

    plan: stages for a budget. Without a budget, `scores` treats all pixels alike.
    """

    plan: Callable[[float], Plan] = lambda _budget: Plan(())

    @property
    def cost(self) -> str:
        """Cost of the score in words: rays of pixels with the fewest and with all looks."""
        return f"2 to {1 + self.extra_rays} rays a pixel"

    def first_look(self) -> Strategy:
        """Strategy with the needs of the first score within a budget: the finer ray of every pixel."""
        return replace(self, needs=frozenset({FINE}))

    def scores_within(self, buffers: PixelBuffers, budget: float, looks: Looks | None = None) -> np.ndarray:
        """(P,) float32 scores of a view, of which a share `budget` of the active pixels is refined.

        buffers: as of `first_look`; buffers that hold all pixels are not computed again. looks: None if they hold all
        needs of the strategy. Raises SettingError for a budget outside 0 to 1.
        """
        from .plus.weights import shipped_estimators

        estimators = buffers.estimators or shipped_estimators()
        return staged_scores(buffers, looks, self.plan(budget), budget, estimators)


def in_stages(strategy: Strategy, plan: Callable[[float], Plan]) -> StagedStrategy:
    """Copy of a strategy with a plan for budgets, named `NAME-staged`."""
    same = {field.name: getattr(strategy, field.name) for field in fields(Strategy)}
    staged = {
        "name": strategy.name + SUFFIX,
        "title": f"{strategy.title}, in stages",
        "description": f"{strategy.title} with fewer rays for pixels of clear rank; choose it to save time",
    }
    return StagedStrategy(**same | staged, plan=plan)
