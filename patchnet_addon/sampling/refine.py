# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine by a budget: the active pixels with the highest scores take the reference (methods 3, 7.25)."""

from __future__ import annotations

import numpy as np

from ..runtime.errors import SettingError
from .frame import Frame
from .pixel_hash import pixel_hash


def priority(frame: Frame, score: np.ndarray) -> np.ndarray:
    """(P,): scores times importance to the user."""
    return score if frame.importance is None else score * frame.importance


def refinement_order(frame: Frame, score: np.ndarray) -> np.ndarray:
    """(A,) int64 indices of the active pixels, first refined first; ties go by a fixed hash of the index.

    Pixels of importance 0 come last: they are the ones beyond `refinable`.
    """
    active = np.flatnonzero(frame.active)
    ties = pixel_hash(len(score))[active]
    urgency = priority(frame, score)[active]
    if frame.importance is None:
        return active[np.lexsort((ties, -urgency))]
    return active[np.lexsort((ties, -urgency, frame.importance[active] <= 0))]


def refinable(frame: Frame) -> int:
    """Count the active pixels that may be refined at all."""
    if frame.importance is None:
        return int(np.count_nonzero(frame.active))
    return int(np.count_nonzero(frame.active & (frame.importance > 0)))


def budget_count(budget: float, active: int) -> int:
    """Pixels that a budget X in [0, 1] pays for: round(X |A|); raises SettingError outside that range."""
    if not 0.0 <= budget <= 1.0:
        raise SettingError(f"Budget {budget} is outside 0 to 1: give the share of active pixels to refine")
    return round(budget * active)


def refined_count(frame: Frame, budget: float, active: int) -> int:
    """Count the `active` pixels, in their order, that a budget refines: those that it pays for and that matter."""
    return min(budget_count(budget, active), refinable(frame))


def refine(frame: Frame, score: np.ndarray, budget: float) -> np.ndarray:
    """(P,) bool: pixels that a budget in [0, 1] refines, chosen by `score` (P,)."""
    order = refinement_order(frame, score)
    mask = np.zeros(len(score), bool)
    mask[order[: refined_count(frame, budget, len(order))]] = True
    return mask


def refined_picture(frame: Frame, mask: np.ndarray) -> np.ndarray:
    """(P,) float32: the reference where `mask` (P,) is set, the preview elsewhere; the frame needs its reference."""
    assert frame.reference is not None
    return np.where(mask, frame.reference, frame.preview)


def refined_colors(frame: Frame, mask: np.ndarray) -> np.ndarray:
    """(P, 3) float32: as `refined_picture`, in colour; the frame needs its colours and its reference."""
    assert frame.preview_color is not None and frame.reference_color is not None
    return np.where(mask[:, None], frame.reference_color, frame.preview_color)


def urgency(frame: Frame, score: np.ndarray, budget: float) -> np.ndarray:
    """(P,) float32: 1 for the pixel that is refined first, falling to 0 at the budget's end, 0 beyond it.

    Pixels of score 0 stay 0: nothing is known to be wrong there, though the budget may reach them.
    """
    order = refinement_order(frame, score)
    count = refined_count(frame, budget, len(order))
    amount = np.zeros(len(score), np.float32)
    amount[order[:count]] = 1.0 - np.arange(count, dtype=np.float32) / max(count, 1)
    return np.where(priority(frame, score) > 0, amount, np.float32(0.0))
