# SPDX-License-Identifier: GPL-3.0-or-later
"""Generalisation of networks to scenes that they were not trained on, at 30 % over screen-space variance (methods 5).

Names say what a network has learned from (`network_names.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .bootstrap import Bootstrap, number_with_interval
from .claims import VARIANCE
from .network_names import WITHOUT
from .patch_networks import SCORES, PatchNetwork, strategy_name

BUDGET = 0.3


def generalisation_of(
    draws: Mapping[str, Bootstrap], networks: Sequence[PatchNetwork], octrees: Mapping[str, str]
) -> dict[str, Any]:
    """Errors of networks over that of screen-space variance at BUDGET on every scene, by score, with intervals.

    draws: of each scene. octrees: hash of each scene's. `networks` of a score: {network: {scene: {value, low, high,
    seen}}}, None where the variance leaves no error. `spread`: {scene: {least, greatest, ratio}} over networks that are
    named after one of the scenes.
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
        alone = [name for name in cells if name in octrees]
        found[score] = {
            "networks": cells,
            "spread": {scene: _spread([cells[name][scene]["value"] for name in alone]) for scene in octrees},
        }
    return found


def seen(network: PatchNetwork, scene: str, octree: str) -> bool:
    """Return whether a scene, whose octree has this hash, was in a network's training, by its name or its weights."""
    if network.name.startswith(WITHOUT):
        named = scene != network.name.removeprefix(WITHOUT)
    else:
        named = scene == network.name
    return named or octree in network.octrees


def _spread(values: Sequence[float | None]) -> dict[str, float | None]:
    """Least and greatest of the values, and their ratio; None where there are not two."""
    there = [value for value in values if value is not None]
    if len(there) < 2:
        return {"least": None, "greatest": None, "ratio": None}
    return {"least": min(there), "greatest": max(there), "ratio": max(there) / min(there) if min(there) > 0 else None}
