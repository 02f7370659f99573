# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies in use in an evaluation: those of the registry that are asked for, and those of weights files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling.strategy import Strategy
from ..strategies.registry import EVALUATED, evaluated
from .networks.strategies import map_strategy
from .patch_networks import NetworkStrategy, PatchNetwork, network_strategies


def strategies_in_use(
    names: Sequence[str], maps: Sequence[Path], networks: Sequence[PatchNetwork] = ()
) -> dict[str, Strategy]:
    """Strategies by name: those called `names`, of the weights files `maps`, and of `networks`, in this order.

    Raises SettingError for a name that there is not, or for two files of one network, and as `map_strategy`.
    """
    found = {name: evaluated(name) for name in names}
    for path in maps:
        strategy = map_strategy(path)
        if strategy.name in found:
            raise SettingError(f"{path} is a second strategy {strategy.name!r}: give one file of each network")
        found[strategy.name] = strategy
    return found | {strategy.name: strategy for network in networks for strategy in network_strategies(network)}


def map_names(strategies: Iterable[Strategy]) -> list[str]:
    """Names of strategies in use that are sampling maps."""
    others = [strategy for strategy in strategies if not isinstance(strategy, NetworkStrategy)]
    return [strategy.name for strategy in others if strategy.name not in EVALUATED]
