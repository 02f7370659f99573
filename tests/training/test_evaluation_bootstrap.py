# SPDX-License-Identifier: GPL-3.0-or-later
"""Block bootstrap against a loop over resampled frames (methods 5)."""

import numpy as np
import pytest

from patchnet.tests.training.frame_samples import NAMES, random_track
from patchnet.training.evaluation.bootstrap import Bootstrap, block_frames
from patchnet.training.evaluation.curves import TrackErrors, crossing, pooled_mse

RESAMPLES = 200


@pytest.fixture(scope="module")
def tracks() -> list[TrackErrors]:
    """Two tracks, the last blocks of which are shorter than the others."""
    return [random_track(23), random_track(31, seed=500, height=9)]


def resampled_tracks(tracks: list[TrackErrors], seed: int) -> list[np.ndarray]:
    """Pooled curves (S, 101) of each resample: frames of drawn blocks are listed one by one."""
    rng = np.random.default_rng(seed)
    drawn = []
    for track in tracks:
        length = block_frames(len(track.active))
        blocks = -(-len(track.active) // length)
        drawn.append((track, length, rng.integers(0, blocks, (RESAMPLES, blocks))))
    curves = []
    for resample in range(RESAMPLES):
        left, active = np.zeros((len(NAMES), 101)), 0
        for track, length, blocks in drawn:
            for block in blocks[resample]:
                for frame in range(block * length, min((block + 1) * length, len(track.active))):
                    left += track.left[frame]
                    active += track.active[frame]
        curves.append(left / active)
    return curves


def ends(figures: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """2.5th and 97.5th percentile."""
    ordered = np.sort(figures, axis=0)
    return ordered[round(0.025 * (RESAMPLES - 1))], ordered[RESAMPLES - 1 - round(0.025 * (RESAMPLES - 1))]


def test_intervals_are_those_of_a_loop_over_frames(tracks: list[TrackErrors]) -> None:
    bootstrap = Bootstrap.of(tracks, RESAMPLES, seed=3)
    pooled, curves = pooled_mse(tracks), resampled_tracks(tracks, seed=3)
    for row, name in enumerate(NAMES):
        others = [other for other in NAMES if other not in (name, "optimal")]
        rows = [NAMES.index(other) for other in others]
        cases = [
            (bootstrap.mse(name), lambda curve, row=row: curve[row]),
            (bootstrap.ratio(name, "random", 0.29), lambda curve, row=row: curve[row, 29] / curve[1, 29]),
            (bootstrap.crossing(name, others), lambda curve, row=row, rows=rows: crossing(curve[row], curve[rows])),
        ]
        for interval, figure in cases:
            np.testing.assert_allclose(interval.value, figure(pooled), rtol=1e-9, atol=1e-12)
            low, high = ends([figure(curve) for curve in curves])
            np.testing.assert_allclose(interval.low, low, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(interval.high, high, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "frames, length", [(2000, 50), (500, 50), (530, 50), (499, 49), (40, 4), (19, 1), (10, 1), (9, 1), (2, 1)]
)
def test_length_of_blocks(frames: int, length: int) -> None:
    assert block_frames(frames) == length
    assert -(-frames // length) >= min(10, frames)
