# SPDX-License-Identifier: GPL-3.0-or-later
"""Sanity checks of measured errors, which hold for every scene and strategy (methods 3.1, 3.2, 5)."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from ..strategies.registry import STAGED
from .curves import BUDGETS, OPTIMAL, RANDOM, TrackErrors

# Sums of the same pixels in another order differ by that much of the frame's whole error.
ROUNDING = 1e-9
# `optimal` ranks by differences in float32, so pixels whose errors agree to 24 bits may stand in any order.
RANKING = 1e-6
# Of the standard errors of the random strategy at half the budget, where they are largest. Chance leaves a band of five
# of them, over all budgets, once in 10^5 tracks.
STANDARD_ERRORS = 5.0


class CheckError(PatchNetError):
    """Measured errors contradict their definition: the message names scene, strategy, frame and budget."""


def check_track(track: TrackErrors) -> None:
    """Check the errors of a track; `optimal` and `random` must be among its strategies.

    Every error is a number, none is left at budget 1, all strategies begin with the same, no curve rises but of those
    that rank anew for each budget, none is below `optimal` in any frame, and `random` is near its line. Raises
    CheckError at the first that does not hold, and SettingError if one of the two strategies was not measured.
    """
    best = track.left[:, track.row(OPTIMAL), None]
    track.row(RANDOM)
    begin = best[..., :1]  # (F, 1, 1)
    left = track.left
    _require(track, np.isfinite(left) & (left >= 0), "has an error that is negative or no number")
    _require(track, left[..., -1:] <= ROUNDING * begin, "has an error left where all is refined", 100)
    same = np.abs(left[..., :1] - begin) <= ROUNDING * begin
    _require(track, same, f"begins with another error than {OPTIMAL!r}")
    falls = np.diff(left) <= ROUNDING * begin
    falls[:, [row for row, name in enumerate(track.strategies) if name in STAGED]] = True
    _require(track, falls, "has an error that rises with the budget", 1)
    _require(track, left >= best - RANKING * begin, f"is below {OPTIMAL!r}, which nothing can be")
    check_random(track)


def check_random(track: TrackErrors) -> None:
    """Check that the pooled error of `random` is within STANDARD_ERRORS of its expectation (methods 3.2).

    The expectation is (1 - X) MSE(0), with X the share that whole pixels make of the budget. Raises CheckError.
    """
    frames = track.active > 0
    active = track.active[frames, None]
    left = track.left[frames, track.row(RANDOM)]
    share = np.rint(active * BUDGETS) / active  # as `budget_count` rounds
    off = np.abs((left - (1 - share) * left[:, :1]).sum(axis=0))
    # All frames follow one order of pixels, so their deviations may add up: standard errors are added, not squares.
    error = (np.sqrt(active[:, 0] * track.variance[frames]) / 2).sum()
    allowed = STANDARD_ERRORS * error + ROUNDING * left[:, 0].sum()
    worst = int(off.argmax()) if off.size else 0
    if off.size and not off[worst] <= allowed:
        raise CheckError(
            f"Scene {track.scene!r}, strategy {RANDOM!r}, budget {worst} %: the error left is {off[worst]:.6g} off its "
            f"expectation, and chance explains {allowed:.6g}: the order of pixels or the sums are wrong"
        )


def _require(track: TrackErrors, holds: np.ndarray, what: str, first_budget: int = 0) -> None:
    """Raise CheckError for the first of (F, S, B) that does not hold; its first budget is `first_budget` %."""
    if not holds.all():
        frame, row, budget = np.argwhere(~holds)[0]
        raise CheckError(
            f"Scene {track.scene!r}, strategy {track.strategies[row]!r}, frame {frame}, budget {budget + first_budget} "
            f"%: it {what}: its scores or errors were measured wrongly"
        )
