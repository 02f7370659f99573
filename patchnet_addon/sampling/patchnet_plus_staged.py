# SPDX-License-Identifier: GPL-3.0-or-later
"""Error estimator with four finer rays in stages: the fastest order within a budget (methods 12.5)."""

from . import patchnet_plus
from .plus.forms import FORMS
from .staged_plans import plan_of
from .staged_strategy import in_stages

STRATEGY = in_stages(patchnet_plus.STRATEGIES[0], plan_of(FORMS["plus-4"]))
