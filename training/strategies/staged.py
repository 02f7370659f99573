# SPDX-License-Identifier: GPL-3.0-or-later
"""Error estimators in stages to measure beside others: with one finer ray, and without the network (methods 12.5)."""

from __future__ import annotations

from ...patchnet_addon.sampling import patchnet_plus
from ...patchnet_addon.sampling.patchnet_plus_staged import plan_of
from ...patchnet_addon.sampling.plus.forms import FORMS
from ...patchnet_addon.sampling.staged_strategy import in_stages
from . import plain_plus

_WHOLE = {strategy.name: strategy for module in (patchnet_plus, plain_plus) for strategy in module.STRATEGIES}
STRATEGIES = tuple(
    in_stages(_WHOLE[name], plan_of(FORMS[form]))
    for name, form in (("patchnet-plus-1", "plus-1"), ("plain-plus-4", "plain-4"), ("plain-plus-1", "plain-1"))
)
