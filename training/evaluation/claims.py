# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims of the paper, tested by numbers, and errors of networks on held-out scenes (methods 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...patchnet_addon.sampling.strategy import Group
from . import WITHOUT
from .bootstrap import Bootstrap, number_with_interval
from .curves import BUDGETS
from .strategies import SCORES, PatchNetwork, strategy_name

VARIANCE = "ss-variance"
LOWEST_FROM = 0.13
RATIOS = (0.1, 0.2, 0.3, 0.4, 0.5)
HALF = 0.5
_ORACLES = ("patchnet-exact", "patchnet-behind-exact")
"""The network's scores with exact patches, which separate errors of the network from those of the score."""
_REFERENCES = frozenset({"screen-space", "world-space"})
_NOT_IN_THE_PAPER = frozenset({"random", "ss-variance-hits", "ws-lut-coverage", "ss-unet", "plain-plus-0"})
BUDGET = 0.3


def claims_of(draws: Mapping[str, Bootstrap], groups: Mapping[str, Group]) -> dict[str, Any]:
    """Claims by name, each with its results by scene and strategy, with intervals (methods 5).

    lowest: the strategy is below all references of the paper from a budget on, which should be 13 % at most;
    share_of_budgets: share of the budgets from 13 % on at which it is. half: at 30 % the strategy leaves half of the
    error of screen-space variance. Both are tested for all strategies of the network and for the exact oracles of their
    scores. groups: of the strategies in use, by name.
    """
    return {
        "lowest": {scene: _lowest(draw, groups) for scene, draw in draws.items()},
        "half": {scene: _half(draw, groups) for scene, draw in draws.items()},
    }


def _lowest(draw: Bootstrap, groups: Mapping[str, Group]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    others = _references(draw, groups)
    if not others:
        return found
    errors = np.array([draw.mse(other).value for other in others])
    for name in _asked(draw, groups):
        interval = draw.crossing(name, others)
        lowest = np.asarray(draw.mse(name).value) < errors.min(axis=0)
        found[name] = number_with_interval(interval) | {
            "holds": bool(interval.value <= LOWEST_FROM),
            "share_of_budgets": float(lowest[(BUDGETS >= LOWEST_FROM) & (BUDGETS < 1)].mean()),
        }
    return found


def _references(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies that the paper compares with: they use the screen or the octree, without further rays."""
    return [name for name in draw.strategies if groups[name] in _REFERENCES and name not in _NOT_IN_THE_PAPER]


def _asked(draw: Bootstrap, groups: Mapping[str, Group]) -> list[str]:
    """Strategies of the network, then the exact oracles measured beside them."""
    networks = [name for name in draw.strategies if groups[name] == "network"]
    return [*networks, *(name for name in _ORACLES if name in draw.strategies)]


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


def generalisation_of(
    draws: Mapping[str, Bootstrap], networks: Sequence[PatchNetwork], octrees: Mapping[str, str]
) -> dict[str, Any]:
    """Errors of networks over that of screen-space variance at BUDGET on every scene, by score, with intervals.

    draws: of each scene. octrees: hash of each scene's. `networks` of a score: {network: {scene: {value, low, high,
    seen}}}, None where the variance leaves no error.
    """
    found = {}
    for score in SCORES:
        cells = {
            network.name: {
                scene: number_with_interval(draws[scene].ratio(strategy_name(network.name, score), VARIANCE, (BUDGET,)))
                | {"seen": seen(network, scene, octree)}
                for scene, octree in octrees.items()
            }
            for network in networks
        }
        found[score] = {"networks": cells}
    return found


def seen(network: PatchNetwork, scene: str, octree: str) -> bool:
    """Return whether a scene, by the hash of its octree, was in a network's training, by its name or its weights."""
    if network.name.startswith(WITHOUT):
        named = scene != network.name.removeprefix(WITHOUT)
    else:
        named = scene == network.name
    return named or octree in network.octrees
