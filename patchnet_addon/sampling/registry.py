# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies by name, best first; a new one is one file and one line."""

from ..runtime.errors import SettingError
from . import (
    fine_rays,
    fusion,
    optimal,
    patchnet,
    patchnet_behind,
    patchnet_behind_exact,
    patchnet_exact,
    random,
    ss_variance,
)
from .strategy import Strategy

DEFAULT = "patchnet-behind"

STRATEGIES: dict[str, Strategy] = {
    module.STRATEGY.name: module.STRATEGY
    for module in (
        patchnet_behind,
        patchnet,
        ss_variance,
        random,
        patchnet_behind_exact,
        patchnet_exact,
        optimal,
    )
}


def strategy(name: str) -> Strategy:
    """Strategy called `name`; raises SettingError that lists the names if there is none."""
    if name not in STRATEGIES:
        raise SettingError(f"There is no strategy {name!r}: choose one of {', '.join(STRATEGIES)}")
    return STRATEGIES[name]


RIVALS: dict[str, Strategy] = {
    strategy.name: strategy
    for strategy in (
        fusion.FUSION,
        fine_rays.FINE_RAY,
        fusion.FINE_RAY,
        fine_rays.FINE_RAYS_4,
        fusion.FINE_RAYS_4,
    )
}
"""Strategies for research alone, in every table beside those that users choose (methods 10)."""
