# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves of mean squared error over budgets, of frames and of tracks, and what is read off them (methods 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.sampling import errors, optimal, random
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.refine import refinement_order
from ...patchnet_addon.sampling.staged_looks import KnownLooks
from ...patchnet_addon.sampling.staged_strategy import StagedStrategy
from ...patchnet_addon.sampling.strategy import Strategy

OPTIMAL, RANDOM = optimal.STRATEGY.name, random.STRATEGY.name
BUDGETS = np.arange(101) / 100  # methods 7.25
BUDGETS.setflags(write=False)


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors of one frame under S strategies: what is needed to pool it with others.

    active: A, number of active pixels. left: (S, 101) float64, sum over them of the squared errors that are left
    after each budget of BUDGETS. variance: of the squared errors of the A pixels before refinement (divisor A - 1).
    """

    active: int
    left: np.ndarray
    variance: float


@dataclass(frozen=True, eq=False)
class TrackErrors:
    """Errors of the F frames of a camera track through a scene, in the order of time, under S named strategies.

    scene: its name, for messages. active: (F,) int64. left: (F, S, 101) float64. variance: (F,) float64. All three as
    in `FrameErrors`.
    """

    scene: str
    strategies: tuple[str, ...]
    active: np.ndarray
    left: np.ndarray
    variance: np.ndarray

    @classmethod
    def of(cls, scene: str, strategies: Sequence[str], frames: Sequence[FrameErrors]) -> Self:
        """Join frames, whose errors are in the order of `strategies`.

        Raises SettingError without frames, for a name that is there twice, and for errors of another shape.
        """
        if not frames:
            raise SettingError(f"Scene {scene!r} has no frames: render its track first")
        if len(set(strategies)) != len(strategies):
            raise SettingError(f"Scene {scene!r}: a strategy is named twice in {', '.join(strategies)}: name each once")
        shape = len(strategies), len(BUDGETS)
        for number, frame in enumerate(frames):
            if frame.left.shape != shape:
                raise SettingError(
                    f"Scene {scene!r}, frame {number}: errors of shape {frame.left.shape} instead of {shape}: measure "
                    f"every frame under the same {len(strategies)} strategies and {len(BUDGETS)} budgets"
                )
        return cls(
            scene,
            tuple(strategies),
            np.array([frame.active for frame in frames], np.int64),
            np.stack([frame.left for frame in frames]).astype(np.float64),
            np.array([frame.variance for frame in frames], np.float64),
        )

    def row(self, strategy: str) -> int:
        """Index of a strategy; raises SettingError if it was not measured."""
        return row_of(self.strategies, strategy, f"Scene {self.scene!r}")


def row_of(strategies: Sequence[str], strategy: str, where: str) -> int:
    """Index of a strategy among `strategies`; raises SettingError, which begins with `where`, if it is not there."""
    if strategy not in strategies:
        raise SettingError(f"{where}: strategy {strategy!r} was not measured, only {', '.join(strategies)}")
    return strategies.index(strategy)


def frame_orders(buffers: PixelBuffers, scores: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Refinement order (A,) int64 of the active pixels by each strategy's `scores` (P,): the one sort of a frame.

    Raises SettingError for scores of another shape or that are no numbers.
    """
    pixels = buffers.height * buffers.width
    for name, score in scores.items():
        if score.shape != (pixels,):
            raise SettingError(
                f"Strategy {name!r} has scores of shape {score.shape}: give one for each of {pixels} pixels"
            )
        if np.isnan(score).any():
            raise SettingError(f"Strategy {name!r} has scores that are no numbers (NaN): see what it divides by")
    return {name: refinement_order(buffers, score) for name, score in scores.items()}


def frame_errors(buffers: PixelBuffers, orders: Mapping[str, np.ndarray]) -> FrameErrors:
    """Errors of a frame under the strategies whose `orders` (A,) are given, in their order.

    Raises SettingError for a view without a reference, or with importance, which would change what a budget means.
    """
    if buffers.reference is None:
        raise SettingError("The view has no reference: render it before its errors are measured")
    if buffers.importance is not None:
        raise SettingError("The view has importance: strategies are compared without it")
    error = errors.squared_error(buffers)[buffers.active]
    budgets = BUDGETS.tolist()
    left = [errors.sum_left_after(buffers, order, budgets) for order in orders.values()]
    variance = float(error.var(ddof=1)) if len(error) > 1 else 0.0
    return FrameErrors(len(error), np.array(left).reshape(len(orders), len(budgets)), variance)


def rank_staged(measured: FrameErrors, buffers: PixelBuffers, strategies: Mapping[str, Strategy]) -> None:
    """Put the errors of strategies that rank in stages into `measured`, which has those of all by one order each.

    Each budget has stages of its own. The view must have all that they look at, and they read it from there.
    """
    looks = KnownLooks(buffers)
    for row, strategy in enumerate(strategies.values()):
        if isinstance(strategy, StagedStrategy):
            for index, budget in enumerate(BUDGETS.tolist()):
                order = refinement_order(buffers, strategy.scores_within(buffers, looks, budget))
                measured.left[row, index] = errors.sum_left_after(buffers, order, [budget])[0]


def pooled_mse(tracks: Sequence[TrackErrors]) -> np.ndarray:
    """(S, 101) float64: mean squared error over all active pixels of all frames of all tracks (methods 5).

    Raises SettingError for no tracks, or tracks that were not measured under the same strategies.
    """
    same_strategies(tracks)
    left = np.sum([track.left.sum(axis=0) for track in tracks], axis=0)
    return left / max(sum(int(track.active.sum()) for track in tracks), 1)


def same_strategies(tracks: Sequence[TrackErrors]) -> tuple[str, ...]:
    """Names of the strategies that all tracks have in common order; raises SettingError if they have not."""
    if not tracks:
        raise SettingError("No tracks to pool: give at least one")
    for track in tracks[1:]:
        if track.strategies != tracks[0].strategies:
            raise SettingError(
                f"Scenes {tracks[0].scene!r} and {track.scene!r} were measured under different strategies "
                f"({', '.join(tracks[0].strategies)}; {', '.join(track.strategies)}): pool those of the same ones"
            )
    return tracks[0].strategies


def mean_frame_mse(tracks: Sequence[TrackErrors]) -> np.ndarray:
    """(S, 101) float64: mean over frames of each frame's own mean squared error; frames without active pixels have
    none and do not count (methods 5). Raises SettingError as `pooled_mse`."""
    same_strategies(tracks)
    frames = [track.left[track.active > 0] / track.active[track.active > 0, None, None] for track in tracks]
    return np.sum([frame.sum(axis=0) for frame in frames], axis=0) / max(sum(map(len, frames)), 1)


def psnr(mse: np.ndarray) -> np.ndarray:
    """Peak signal-to-noise ratio in dB of each mean squared error, of any shape; infinite without error."""
    return np.vectorize(errors.psnr, otypes=[np.float64])(mse)


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

    Where both are without error, as at budget 1, the curve needs not be below. Infinite if it is never below from
    some budget on (methods 5).
    """
    least = others.min(axis=-2)
    below = mse < least
    stays = below | ((mse == 0) & (least == 0))
    stays = np.logical_and.accumulate(stays[..., ::-1], axis=-1)[..., ::-1]
    return np.where((stays & below).any(axis=-1), BUDGETS[stays.argmax(axis=-1)], np.inf)
