# SPDX-License-Identifier: GPL-3.0-or-later
"""Strategies by name, best first; a new one is one file and one line."""

from ..runtime.errors import SettingError
from . import optimal, patchnet, patchnet_behind, patchnet_plus, random, ss_variance
from .strategy import Strategy

DEFAULT = "patchnet-plus"
FOR_USERS = (DEFAULT, "patchnet-plus-1", "ss-variance")  # the best, a faster one, and one without look-ahead

STRATEGIES: dict[str, Strategy] = {
    strategy.name: strategy
    for strategy in (
        *patchnet_plus.STRATEGIES,
        patchnet_behind.STRATEGY,
        patchnet.STRATEGY,
        ss_variance.STRATEGY,
        random.STRATEGY,
        patchnet_behind.EXACT_ORACLE,
        patchnet.EXACT_ORACLE,
        optimal.STRATEGY,
    )
}


def strategy(name: str) -> Strategy:
    """Strategy called `name`; raises SettingError that lists the names if there is none."""
    if name not in STRATEGIES:
        raise SettingError(f"There is no strategy {name!r}: choose one of {', '.join(STRATEGIES)}")
    return STRATEGIES[name]
