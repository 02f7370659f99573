# SPDX-License-Identifier: GPL-3.0-or-later
"""Mean squared error over active pixels, as a function of the budget (methods 5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .pixel_buffers import PixelBuffers
from .refine import refined_count, refinement_order


def squared_error(buffers: PixelBuffers) -> np.ndarray:
    """(P,) float64: (S - L32)^2, with S shown in unrefined pixels (L1 or predicted); the view needs its reference."""
    assert buffers.reference is not None
    return (buffers.shown.astype(np.float64) - buffers.reference) ** 2


def mse_at(buffers: PixelBuffers, score: np.ndarray, budgets: Sequence[float]) -> np.ndarray:
    """(B,) float64: mean squared error over the active pixels after each budget in [0, 1].

    Refined pixels take the reference, so their error is 0; pixels of importance 0 keep theirs. A view without active
    pixels has no error.
    """
    return left_after(buffers, refinement_order(buffers, score), budgets)


def left_after(buffers: PixelBuffers, order: np.ndarray, budgets: Sequence[float]) -> np.ndarray:
    """(B,) float64: as `mse_at`, for active pixels in a given `order` (A,)."""
    return sum_left_after(buffers, order, budgets) / max(len(order), 1)


def sum_left_after(buffers: PixelBuffers, order: np.ndarray, budgets: Sequence[float]) -> np.ndarray:
    """(B,) float64: sum of the squared errors of the active pixels, in their `order` (A,), after each budget."""
    error = squared_error(buffers)[order]
    # Summed from the least urgent pixel, so that the error left at budget 1 is exactly 0.
    left = np.concatenate([np.cumsum(error[::-1])[::-1], [0.0]])
    return left[[refined_count(buffers, budget, len(error)) for budget in budgets]]


def psnr(mse: float) -> float:
    """Peak signal-to-noise ratio in dB of a mean squared error, peak 1; infinite without error."""
    return float("inf") if mse <= 0.0 else float(-10.0 * np.log10(mse))
