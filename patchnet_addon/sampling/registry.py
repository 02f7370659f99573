# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies by name, best first; a new one is one file and one line."""

from ..runtime.errors import SettingError
from . import (
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
