# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans of stages: which forms of the error estimator score pixels how far from a budget's cut (methods 12.5)."""

from __future__ import annotations

import math
from collections.abc import Callable

from .plus.forms import FORMS, Form
from .staged_ranking import Stage

Plan = Callable[[float], tuple[Stage, ...]]
"""Stages for a budget, a share of the active pixels."""
_NETWORK_FROM = 0.15  # budget: below it, looking behind and decoding cost more than the samples that they save
_ALL_FROM = 0.75  # budget: from here on nearly all pixels are near the cut or before it
_EVERY_PIXEL = 0.0, math.inf


def plan_of(last: Form) -> Plan:
    """Plan whose last stage has a form with one finer ray, or four; it is the only one where the budget is large."""
    near_cut = _four_rays(last) if last.rays == 4 else _one_ray(last)
    return lambda budget: near_cut(budget) if budget < _ALL_FROM else (Stage(last, *_EVERY_PIXEL),)


def _one_ray(last: Form) -> Plan:
    """Plan with one finer ray; `last`, which also looks behind the patch, takes part where it is worth its time."""

    def plan(budget: float) -> tuple[Stage, ...]:
        near = Stage(FORMS["fine-1"], 0.4, 1.5 + 5.0 * budget)
        return (near, Stage(last, 0.7, 1.2)) if budget >= _NETWORK_FROM else (near,)

    return plan


def _four_rays(last: Form) -> Plan:
    """Plan with one finer ray for all pixels, and four for those near the cut."""
    return lambda _budget: (Stage(FORMS["fine-1"], *_EVERY_PIXEL), Stage(last, 0.7, 1.25))
