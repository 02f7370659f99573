# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels that an expensive renderer samples within a budget, those of highest priority."""

from __future__ import annotations

import numpy as np

from ..runtime.errors import SettingError
from .ranking import Ranking
from .refine import refinable


def chosen_pixels(ranking: Ranking, first: np.ndarray, budget: float) -> np.ndarray:
    """(P,) bool: a budget's share of all P pixels of a view, rounded down, in the order of the ranking.

    first: (P,) bool, pixels that come before all others, those of highest priority first. Pixels that are not active
    come last; those of importance 0 are chosen only where they are of the first. Raises SettingError for a budget
    outside 0 to 1.
    """
    if not 0.0 <= budget <= 1.0:
        raise SettingError(f"Budget {budget} is outside 0 to 1: give the share of pixels to render")
    before = np.flatnonzero(first)
    before = before[np.argsort(-ranking.priority[before], kind="stable")]
    buffers = ranking.buffers
    matter = True if buffers.importance is None else buffers.importance > 0
    after = np.concatenate([ranking.order[: refinable(buffers)], np.flatnonzero(~buffers.active & matter)])
    mask = np.zeros(len(first), bool)
    mask[np.concatenate([before, after[~first[after]]])[: int(budget * len(first) + 1e-9)]] = True
    return mask
