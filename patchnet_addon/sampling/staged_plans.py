# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans of stages: which forms of the error estimator score pixels how far from a budget's cut (methods 12.5)."""

from __future__ import annotations

import math
from collections.abc import Callable

from .plus.forms import FORMS, Form
from .staged_ranking import Plan, Stage

_NETWORK_FROM = 0.25  # budget: below it, looking behind and decoding cost more than the samples that they save
_FOUR_FROM = 0.15  # budget: below it, it is cheaper to choose who gets four rays than to trace those of all pixels
_ALL_FROM = 0.75  # budget: from here on nearly all pixels are near the cut or before it
_EVERY_PIXEL = 0.0, math.inf


def plan_of(last: Form) -> Callable[[float], Plan]:
    """Plan for a budget, with a last form of one finer ray or of four; it is the only one where the budget is large."""
    near_cut = _four_rays if last.rays == 4 else _one_ray
    return lambda budget: near_cut(last, budget) if budget < _ALL_FROM else Plan(1, (Stage(last, *_EVERY_PIXEL),))


def _one_ray(last: Form, budget: float) -> Plan:
    """Plan with one finer ray; `last`, which also looks behind the patch, takes part where it is worth its time."""
    near = Stage(FORMS["fine-1"], 0.6, 1.3 + 5.0 * budget)
    return Plan(1, (near, Stage(last, 0.7, 1.2)) if budget >= _NETWORK_FROM else (near,))


def _four_rays(last: Form, budget: float) -> Plan:
    """Plan with four finer rays for the pixels near the cut, or for all where that is cheaper than to choose."""
    if budget < _FOUR_FROM:
        return Plan(1, (Stage(FORMS["fine-1"], *_EVERY_PIXEL), Stage(last, 0.7, 1.25)))
    return Plan(4, (Stage(FORMS["fine-4"], 0.7, 1.25),))
