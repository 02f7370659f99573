# SPDX-License-Identifier: GPL-3.0-or-later
"""Error estimator with four finer rays in stages: the fastest order within a budget (methods 12.5).

A plan assigns forms of the estimator to pixels by their distance from the budget's cut.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from . import patchnet_plus
from .plus.forms import FORMS, Form
from .staged_strategy import Plan, Stage, in_stages

_NETWORK_FROM = 0.25  # budget: below it, rays behind and decoding cost more than the samples they save
_AROUND_FROM = 0.07  # budget: below it, the largest differences of the finer ray come first in any order
_ALL_FROM = 0.75  # budget: from here on nearly all pixels are near the cut or before it
_EVERY_PIXEL = 0.0, math.inf


def plan_of(last: Form) -> Callable[[float], Plan]:
    """Plan for a budget, with a last form of one finer ray or of four; it is the only one where the budget is large."""

    def plan(budget: float) -> Plan:
        if budget >= _ALL_FROM:
            return Plan((Stage(last, *_EVERY_PIXEL),))
        return _FOUR_RAYS if last.rays == 4 else _one_ray(last, budget)

    return plan


def _one_ray(last: Form, budget: float) -> Plan:
    """Plan with one finer ray; `last`, which also traces behind the patch, takes part where it is worth its time."""
    near = Stage(FORMS["fine-1"], 0.5, 1.3 + 5.0 * budget)
    stages = (near, Stage(last, 0.7, 1.2)) if budget >= _NETWORK_FROM else (near,)
    return Plan(stages, around=budget >= _AROUND_FROM)


# Four finer rays for the pixels near the cut. The network adds less to them than decoding costs.
_FOUR_RAYS = Plan((Stage(FORMS["fine-1"], *_EVERY_PIXEL), Stage(FORMS["fine-4"], 0.4, 1.8)), around=False)

STRATEGY = in_stages(patchnet_plus.STRATEGIES[0], plan_of(FORMS["plus-4"]))
