# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies over all scenes of an evaluation: geometric means of their errors, and pairs of them at equal time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .costs import CYCLES_MS_PER_PIXEL, total_ms

BUDGETS = 5, 10, 20, 30, 50, 70  # percent
_LEAST = 1e-9  # of a ratio, for its logarithm


def geometric_means(scenes: Mapping[str, Any], strategy: str, over: str) -> list[float]:
    """Geometric mean over scenes of a strategy's error over that of another one, at BUDGETS."""
    ratios = np.array(
        [
            [values["mse"][strategy][budget] / max(values["mse"][over][budget], _LEAST) for budget in BUDGETS]
            for values in scenes.values()
        ]
    )
    return [float(value) for value in np.exp(np.log(np.maximum(ratios, _LEAST)).mean(axis=0))]


def error_ratios(scenes: Mapping[str, Any], strategy: str, rival: str, price: str | None) -> np.ndarray:
    """Error that a strategy leaves over that of a rival, (scenes, budgets) at BUDGETS.

    price: of a refined pixel's samples, "own" rays or "cycles"; the rival then refines what it can in the same total
    time (`total_ms`). None: both refine the same budget. Where neither leaves anything it is 1.
    """
    ratios = []
    for values in scenes.values():
        left, theirs = (np.asarray(values["mse"][name]) for name in (strategy, rival))
        if price is not None:
            ms = CYCLES_MS_PER_PIXEL if price == "cycles" else values["reference_ms_per_pixel"]
            theirs = np.interp(total_ms(values, strategy, ms), total_ms(values, rival, ms), theirs)
        left, theirs = left[list(BUDGETS)], theirs[list(BUDGETS)]
        ratios.append(np.where(left == theirs, 1.0, left / np.maximum(theirs, np.finfo(float).tiny)))
    return np.array(ratios)


def scenes_ahead(scenes: Mapping[str, Any], strategy: str, rival: str, price: str | None) -> list[int]:
    """Number of scenes in which a strategy leaves less than a rival, at BUDGETS; price: as `error_ratios`."""
    return [int(count) for count in (error_ratios(scenes, strategy, rival, price) < 1).sum(axis=0)]
