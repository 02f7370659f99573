# SPDX-License-Identifier: GPL-3.0-or-later
"""Ablations of the error estimator: without the network's prediction, with the same training (methods 12.4)."""

from ...patchnet_addon.sampling.patchnet_plus import estimator_strategy
from ...patchnet_addon.sampling.plus.forms import FORMS

STRATEGIES = tuple(
    estimator_strategy(
        FORMS[f"plain-{rays}"],
        None,
        f"plain-plus-{rays}",
        f"Plus without PatchNet, {words}",
        f"The estimate of PatchNet Plus, {words}, trained without the network's coverage and luminance",
    )
    for rays, words in ((4, "four rays"), (1, "one ray"), (0, "no ray"))
)
