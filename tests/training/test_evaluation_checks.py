# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of measured errors: they pass what is right, and name scene and strategy of what is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.tests.training.frame_samples import NAMES, errors_of, random_frame, random_track, scores_of
from patchnet.training.evaluation.curves import (
    CheckError,
    TrackErrors,
    check_random,
    check_track,
    frame_errors,
    frame_orders,
)

OPTIMAL, RANDOM, VARIANCE = range(3)


@pytest.fixture(scope="module")
def track() -> TrackErrors:
    return random_track(12, "hangar")


def changed(track: TrackErrors, place: tuple, value: float) -> TrackErrors:
    """The same errors, one of which is another."""
    left = track.left.copy()
    left[place] = value
    return replace(track, left=left)


@pytest.mark.parametrize("seed", range(5))
def test_right_errors_pass(seed: int) -> None:
    check_track(random_track(8, seed=100 * seed))
    check_track(random_track(1, seed=seed))


def test_frames_without_errors_or_active_pixels_pass() -> None:
    frame = random_frame(1)
    same = replace(frame, reference=frame.preview)
    check_track(TrackErrors.of("still", NAMES, [errors_of(same), errors_of(random_frame(hits=0.0))]))


@pytest.mark.parametrize(
    "place, value, message",
    [
        ((3, VARIANCE, 100), 0.1, "where all is refined.*"),
        ((3, VARIANCE, 0), 99.0, "begins with another error"),
        ((3, VARIANCE, 50), 0.0, "below 'optimal'|rises"),
        ((3, VARIANCE, 50), np.nan, "no number"),
        ((3, VARIANCE, 50), -1.0, "negative"),
    ],
)
def test_wrong_errors_are_named(track: TrackErrors, place: tuple, value: float, message: str) -> None:
    with pytest.raises(CheckError, match=f"'hangar', strategy 'ss-variance', frame 3.*({message})"):
        check_track(changed(track, place, value))


def test_rising_errors_are_named(track: TrackErrors) -> None:
    value = 1.001 * track.left[3, VARIANCE, 59]
    with pytest.raises(CheckError, match="'ss-variance', frame 3, budget 60 %: it has an error that rises"):
        check_track(changed(track, (3, VARIANCE, 60), value))


def test_what_ranks_anew_for_each_budget_may_rise(track: TrackErrors) -> None:
    names = tuple("patchnet-plus-staged" if name == "ss-variance" else name for name in track.strategies)
    staged = replace(track, strategies=names)
    check_track(changed(staged, (3, VARIANCE, 60), 1.001 * track.left[3, VARIANCE, 59]))
    with pytest.raises(CheckError, match="below 'optimal'"):
        check_track(changed(staged, (3, VARIANCE, 10), 0.0))


@pytest.mark.parametrize("name", ["optimal", "ss-variance"])
def test_random_that_knows_something_is_found(name: str) -> None:
    """An order by the errors themselves, or against them, is not random."""
    frames = []
    for seed in range(6):
        buffers = random_frame(seed, 40, 40, hits=0.5)
        scores = scores_of(buffers)
        worse = scores["optimal"] if name == "optimal" else -scores["optimal"]
        frames.append(frame_errors(buffers, frame_orders(buffers, scores | {"random": worse})))
    with pytest.raises(CheckError, match="'hangar', strategy 'random', budget"):
        check_track(TrackErrors.of("hangar", NAMES, frames))


def test_random_passes_in_frames_that_are_all_alike() -> None:
    """Deviations of frames with the same pixels add up, for one order serves all frames."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        buffers = random_frame(int(rng.integers(1 << 30)), 30, 30)
        check_random(TrackErrors.of("still", NAMES, [errors_of(buffers)] * 40))
