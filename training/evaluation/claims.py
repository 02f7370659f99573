# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims of the paper, decided by numbers: where its strategy is lowest, and how far below screen-space variance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...patchnet_addon.sampling.strategy import Group
from .bootstrap import Bootstrap, Interval
from .curves import BUDGETS

PAPER = "patchnet"
VARIANCE = "ss-variance"
LOWEST_FROM = 0.13
RATIOS = (0.1, 0.2, 0.3, 0.4, 0.5)
HALF = 0.5
_REFERENCES = frozenset({"screen-space", "world-space"})


def claims_of(draws: Mapping[str, Bootstrap], groups: Mapping[str, Group]) -> dict[str, Any]:
    """Claims by name, each with what was found on every scene, by name, with intervals (methods 5).

    lowest: the paper's strategy is below all of its references from a budget on, which should be 13 % at most;
    share_of_budgets: of those from 13 % on, where it is.
    half: at 30 % it leaves half of the error of screen-space variance. The same for the network's other strategies.
    groups: of the strategies in use, by name.
    """
    return {
        "lowest": {scene: _lowest(draw, groups) for scene, draw in draws.items()},
        "half": {scene: _half(draw, groups) for scene, draw in draws.items()},
    }


def references_of(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies among those that were measured that the paper's is compared with."""
    return [name for name in draw.strategies if groups[name] in _REFERENCES]


def network_of(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies among those that were measured that the network is part of."""
    return [name for name in draw.strategies if groups[name] == "network"]


def _lowest(draw: Bootstrap, groups: Mapping[str, Group]) -> dict[str, Any]:
    found, others = {}, references_of(draw, groups)
    for name in network_of(draw, groups):
        interval = draw.crossing(name, others)
        lowest = np.asarray(draw.mse(name).value) < np.min([draw.mse(other).value for other in others], axis=0)
        found[name] = _values(interval) | {
            "holds": bool(interval.value <= LOWEST_FROM),
            "share_of_budgets": float(lowest[(BUDGETS >= LOWEST_FROM) & (BUDGETS < 1)].mean()),
        }
    return found


def _half(draw: Bootstrap, groups: Mapping[str, Group]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in [*network_of(draw, groups), *(name for name in draw.strategies if groups[name] == "rays")]:
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
