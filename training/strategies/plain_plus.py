# SPDX-License-Identifier: GPL-3.0-or-later
"""Ablations of the error estimator: without the network's prediction, with the same training, and staged (methods 12.4,
12.5).
"""

from ...patchnet_addon.sampling import patchnet_plus
from ...patchnet_addon.sampling.patchnet_plus import estimator_strategy, plan_of
from ...patchnet_addon.sampling.plus.forms import FORMS
from ...patchnet_addon.sampling.staged_strategy import in_stages

_PLAIN = tuple(
    estimator_strategy(
        FORMS[f"plain-{rays}"],
        None,
        f"plain-plus-{rays}",
        f"Plus without PatchNet, {words}",
        f"The estimate of PatchNet Plus, {words}, trained without the network's coverage and luminance",
    )
    for rays, words in ((4, "four rays"), (1, "one ray"), (0, "no ray"))
)
_WHOLE = {strategy.name: strategy for strategy in (*patchnet_plus.STRATEGIES, *_PLAIN)}
STRATEGIES = (
    *_PLAIN,
    *(
        in_stages(_WHOLE[name], plan_of(FORMS[form]))
        for name, form in (("patchnet-plus-1", "plus-1"), ("plain-plus-4", "plain-4"), ("plain-plus-1", "plain-1"))
    ),
)
