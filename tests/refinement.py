# SPDX-License-Identifier: GPL-3.0-or-later
"""Refined pixels of a budget by plain scores."""

import numpy as np

from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.refine import refined_mask, refinement_order


def refine(buffers: PixelBuffers, score: np.ndarray, budget: float) -> np.ndarray:
    """(P,) bool: pixels that a budget in [0, 1] refines, chosen by `score` (P,)."""
    return refined_mask(buffers, refinement_order(buffers, score), budget)
