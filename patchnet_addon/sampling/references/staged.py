# SPDX-License-Identifier: GPL-3.0-or-later
"""Error estimator in stages: closer looks at pixels near the budget's cut alone (methods 12.5)."""

from __future__ import annotations

from dataclasses import replace

from .. import patchnet_plus
from ..staged_strategy import StagedStrategy
from . import plain_plus

STRATEGIES = tuple(
    replace(
        strategy,
        name=f"{strategy.name}-staged",
        title=f"{strategy.title}, in stages",
        description=f"{strategy.description}; closer looks at pixels near the budget's cut alone",
    )
    for strategy in (*patchnet_plus.STRATEGIES, *plain_plus.STRATEGIES)
    if isinstance(strategy, StagedStrategy)
)
