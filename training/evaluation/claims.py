# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims of the paper, decided by numbers: where its strategy is lowest, and how far below screen-space variance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...patchnet_addon.sampling.strategy import Group
from .bootstrap import Bootstrap, Interval
from .curves import BUDGETS

VARIANCE = "ss-variance"
LOWEST_FROM = 0.13
BUDGETS_SHOWN = (LOWEST_FROM, 0.2, 0.3, 0.5)
RATIOS = (0.1, 0.2, 0.3, 0.4, 0.5)
HALF = 0.5
ORACLES = {"patchnet": "patchnet-exact", "patchnet-behind": "patchnet-behind-exact"}
"""Strategies of the network, and the same scores of exact patches, which say whether network or score is at fault."""
_REFERENCES = frozenset({"screen-space", "world-space"})
_NOT_IN_THE_PAPER = frozenset({"random", "ss-variance-hits", "ws-lut-coverage", "ss-unet", "plain-plus-0"})


def claims_of(draws: Mapping[str, Bootstrap], groups: Mapping[str, Group]) -> dict[str, Any]:
    """Claims by name, each with what was found on every scene, by name, with intervals (methods 5).

    lowest: the strategy is below all references of the paper from a budget on, which should be 13 % at most;
    share_of_budgets: of those from 13 % on, where it is; lowest_reference: by budget, that with the least error, None
    where the strategy's own is less. lowest_of_more: the same with references that the paper does not have.
    half: at 30 % the strategy leaves half of the error of screen-space variance.
    Each is asked of all strategies of the network and of the exact oracles of their scores.
    groups: of the strategies in use, by name.
    """
    return {
        "lowest": {scene: _lowest(draw, paper_references(draw, groups), groups) for scene, draw in draws.items()},
        "lowest_of_more": {scene: _lowest(draw, references_of(draw, groups), groups) for scene, draw in draws.items()},
        "half": {scene: _half(draw, groups) for scene, draw in draws.items()},
    }


def references_of(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies among those that were measured that look at the screen or at the octree, at no further ray."""
    return [name for name in draw.strategies if groups[name] in _REFERENCES and name != "random"]


def paper_references(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """References among those that were measured that the paper compares with."""
    return [name for name in references_of(draw, groups) if name not in _NOT_IN_THE_PAPER]


def network_of(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies among those that were measured that the network is part of."""
    return [name for name in draw.strategies if groups[name] == "network"]


def _lowest(draw: Bootstrap, others: list[str], groups: Mapping[str, Group]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if not others:
        return found
    errors = np.array([draw.mse(other).value for other in others])
    for name in _asked(draw, groups):
        interval = draw.crossing(name, others)
        own = np.asarray(draw.mse(name).value)
        lowest = own < errors.min(axis=0)
        at = {budget: round(100 * budget) for budget in BUDGETS_SHOWN}
        found[name] = _values(interval) | {
            "holds": bool(interval.value <= LOWEST_FROM),
            "share_of_budgets": float(lowest[(BUDGETS >= LOWEST_FROM) & (BUDGETS < 1)].mean()),
            "lowest_reference": {
                str(budget): None if lowest[place] else others[int(errors[:, place].argmin())]
                for budget, place in at.items()
            },
        }
    return found


def _asked(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies of the network, then the exact oracles that were measured beside them."""
    return [*network_of(draw, groups), *(name for name in ORACLES.values() if name in draw.strategies)]


def _half(draw: Bootstrap, groups: Mapping[str, Group]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in [*_asked(draw, groups), *(name for name in draw.strategies if groups[name] == "rays")]:
        interval = draw.ratio(name, VARIANCE, RATIOS)
        found[name] = {
            "budgets": list(RATIOS),
            "value": np.asarray(interval.value).tolist(),
            "low": np.asarray(interval.low).tolist(),
            "high": np.asarray(interval.high).tolist(),
            "holds": bool(np.asarray(interval.value)[RATIOS.index(0.3)] <= HALF),
        }
    return found


def _values(interval: Interval) -> dict[str, float | None]:
    ends = {"value": interval.value, "low": interval.low, "high": interval.high}
    return {name: float(end) if np.isfinite(end) else None for name, end in ends.items()}
