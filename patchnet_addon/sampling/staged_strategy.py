# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies that rank in stages within a budget (methods 12.5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from .pixel_buffers import PixelBuffers
from .staged_pixels import Looks
from .staged_ranking import Plan, staged_scores
from .strategy import FINE, Strategy

SUFFIX = "-staged"  # of names


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
