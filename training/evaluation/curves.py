# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves of mean squared error over budgets, and figures derived from them (methods 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...patchnet_addon.sampling import errors, optimal
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.refine import refinement_order

OPTIMAL = optimal.STRATEGY.name
BUDGETS = np.arange(101) / 100  # methods 7.25
BUDGETS.setflags(write=False)


class TrackErrors(NamedTuple):
    """Errors of the F frames of a camera track through a scene, in the order of time, under S named strategies.

    active: (F,) int64, number of active pixels. left: (F, S, 101) float64, see `frame_errors`.
    """

    strategies: tuple[str, ...]
    active: np.ndarray
    left: np.ndarray


def frame_orders(buffers: PixelBuffers, scores: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Refinement order (A,) int64 of the active pixels by each strategy's `scores` (P,): the only sort of a frame."""
    return {name: refinement_order(buffers, score) for name, score in scores.items()}


def frame_errors(buffers: PixelBuffers, orders: Mapping[str, np.ndarray]) -> np.ndarray:
    """Squared errors (S, 101) float64 of a frame, summed over active pixels, after each budget of BUDGETS.

    orders: (A,) of S strategies. The view has a reference, and no importance.
    """
    assert buffers.reference is not None and buffers.importance is None
    budgets = BUDGETS.tolist()
    left = [errors.sum_left_after(buffers, order, budgets) for order in orders.values()]
    return np.array(left).reshape(len(orders), len(budgets))


def pooled_mse(tracks: Sequence[TrackErrors]) -> np.ndarray:
    """(S, 101) float64: mean squared error over all active pixels of tracks with the same strategies (methods 5)."""
    left = np.sum([track.left.sum(axis=0) for track in tracks], axis=0)
    return left / max(sum(int(track.active.sum()) for track in tracks), 1)


def random_line(mse: np.ndarray) -> np.ndarray:
    """(..., 101): expected error of random refinement, (1 - X) MSE(0), for curves (..., 101) (methods 3.2)."""
    return mse[..., :1] * (1 - BUDGETS)


def area(mse: np.ndarray) -> np.ndarray:
    """(...): area under curves (..., 101) over budgets from 0 to 1, by the trapezoid rule."""
    return (mse.sum(axis=-1) - (mse[..., 0] + mse[..., -1]) / 2) / (len(BUDGETS) - 1)


def excess_area(mse: np.ndarray, best: np.ndarray) -> np.ndarray:
    """(...): (AUC - AUC of `best`) / (AUC of the random line - AUC of `best`), of curves (..., 101) (methods 5).

    0 for the optimal strategy, whose curve is `best` (..., 101), 1 for random refinement; NaN where nothing can be
    gained, as without errors.
    """
    lowest = area(best)
    gain = area(random_line(best)) - lowest
    return (area(mse) - lowest) / np.where(gain > 0, gain, np.nan)


def crossing(mse: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(...): X*, the smallest budget from which a curve (..., 101) stays below each of `others` (..., M, 101).

    Where both errors are 0, as at budget 1, the curve may be equal. Infinite if it is never below from some budget on
    (methods 5).
    """
    least = others.min(axis=-2)
    below = mse < least
    stays = below | ((mse == 0) & (least == 0))
    stays = np.logical_and.accumulate(stays[..., ::-1], axis=-1)[..., ::-1]
    return np.where((stays & below).any(axis=-1), BUDGETS[stays.argmax(axis=-1)], np.inf)
