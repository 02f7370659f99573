# SPDX-License-Identifier: GPL-3.0-or-later
"""Tsallis entropy contrast of luminance in a 3x3 window, by Xu, Sbert, Xing and Zhang (methods 3.7)."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling.strategy import Strategy
from .distribution import WindowDistribution, contrast_strategy
from .entropy import entropy_contrast

INDICES = (0.5, 1.5, 2.0, 3.0)  # the paper does not state its index


def tsallis_contrast(distribution: WindowDistribution, q: float) -> np.ndarray:
    """Tsallis contrast 1 - H_q / H_q_max of each window (H, W), in [0, 1]; H_q = (1 - sum p^q) / (q - 1).

    q: entropic index above 0; 1 is the limit, the contrast of Shannon's entropy. A window of one pixel has contrast 0.
    """
    if q == 1.0:
        return entropy_contrast(distribution)
    # The definition with p = r / N, without cancellation: exactly 0 for uniform r = 1.
    most = distribution.count ** (q - 1.0) - 1.0
    contrast = (distribution.average(distribution.ratio**q) - 1.0) / np.where(most != 0, most, 1.0)
    return np.maximum(contrast, 0.0)  # rounding may go below 0


def tsallis(q: float) -> Strategy:
    """Tsallis strategy of an entropic index q, called `tsallis-q`: mean luminance times contrast.

    Raises SettingError unless q is finite and above 0.
    """
    if not 0.0 < q < np.inf:
        raise SettingError(f"Entropic index {q} is not above 0: choose a number such as 1.5")
    return contrast_strategy(
        f"tsallis-{q:g}",
        f"Tsallis entropy, q = {q:g}",
        "Mean luminance times the Tsallis entropy contrast of the 3x3 pixels around",
        lambda distribution: tsallis_contrast(distribution, q),
        maximum=0.2,
    )


STRATEGIES = tuple(tsallis(q) for q in INDICES)
