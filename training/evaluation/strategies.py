# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies of an evaluation: of the registry, of map networks, and of networks of `patchnet lab train`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling import patchnet, patchnet_behind
from ...patchnet_addon.sampling.strategy import Strategy
from ..encoders import load_weights
from ..strategies.registry import EVALUATED
from .networks.maps import map_strategy

PREFIX = "pn-"
_ENDINGS = {patchnet.STRATEGY.name: "", patchnet_behind.STRATEGY.name: "-behind"}
SCORES = tuple(_ENDINGS)
"""Strategies of the shipped network, applied to every other network."""


@dataclass(frozen=True)
class PatchNetwork:
    """Named network. weights: its file. hash: of its weights. sample_passes: of its training, 0 if unknown. octrees:
    hashes of its training octrees, if known.
    """

    name: str
    weights: Path
    hash: str
    sample_passes: int = 0
    octrees: frozenset[str] = frozenset()


@dataclass(frozen=True, kw_only=True)
class NetworkStrategy(Strategy):
    """Strategy of the shipped network with another network's prediction, decoded from that network's codes."""

    network: PatchNetwork


def patch_networks(named: Sequence[tuple[str, Path]], lookahead: int) -> tuple[PatchNetwork, ...]:
    """Networks of weights files, by names of a-z, 0-9 and hyphens, with the same `lookahead`.

    Raises SettingError for an invalid or duplicate name, and for a network with another look-ahead; WeightsFileError
    for an invalid file.
    """
    names = [name for name, _ in named]
    for name in names:
        if not re.fullmatch("[a-z0-9-]+", name) or name.endswith(_ENDINGS[patchnet_behind.STRATEGY.name]):
            raise SettingError(
                f"A network cannot be called {name!r}: write its name with a to z, 0 to 9 and hyphens, without -behind "
                "at its end, as in --networks station=run/patchnet.safetensors"
            )
        if names.count(name) > 1:
            raise SettingError(f"Two networks are called {name!r}: give each a different name in --networks")
    found = []
    for name, path in named:
        weights = load_weights(path)
        if weights.lookahead != lookahead:
            raise SettingError(
                f"Network {name!r} looks {weights.lookahead} levels ahead, the evaluation {lookahead}: give networks "
                "of the same look-ahead by --networks or --weights"
            )
        octrees = frozenset(weights.metadata.get("octrees", {}).values())
        found.append(PatchNetwork(name, path, weights.hash, weights.metadata.get("sample_passes", 0), octrees))
    return tuple(found)


def strategy_name(network: str, score: str) -> str:
    """Name of one of SCORES with a named network."""
    return f"{PREFIX}{network}{_ENDINGS[score]}"


def network_name(strategy: str) -> str | None:
    """Name of the network of a strategy; None if it is not of a further network."""
    if not strategy.startswith(PREFIX):
        return None
    return strategy.removeprefix(PREFIX).removesuffix(_ENDINGS[patchnet_behind.STRATEGY.name])


def strategies_in_use(maps: Sequence[Path], networks: Sequence[PatchNetwork] = ()) -> dict[str, Strategy]:
    """Strategies by name: those of the registry, of the weights files `maps`, and of `networks`, in this order.

    Raises SettingError for two files of one network, and as `map_strategy`.
    """
    found = dict(EVALUATED)
    for path in maps:
        strategy = map_strategy(path)
        if strategy.name in found:
            raise SettingError(f"{path} is a second file of strategy {strategy.name!r}: give one file for each network")
        found[strategy.name] = strategy
    for network in networks:
        for strategy in (patchnet.STRATEGY, patchnet_behind.STRATEGY):
            about = {
                "name": strategy_name(network.name, strategy.name),
                "title": f"{strategy.title}, {network.name}",
                "description": f"{strategy.description}; by the network {network.name}",
            }
            found[about["name"]] = NetworkStrategy(**vars(strategy) | about, network=network)
    return found


def map_names(strategies: Iterable[Strategy]) -> list[str]:
    """Names of the sampling-map strategies."""
    others = [strategy for strategy in strategies if not isinstance(strategy, NetworkStrategy)]
    return [strategy.name for strategy in others if strategy.name not in EVALUATED]
