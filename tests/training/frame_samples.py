# SPDX-License-Identifier: GPL-3.0-or-later
"""Scores of frames of noise, and their tracks, for tests of the evaluation."""

import numpy as np

from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.tests.engine.test_sampling import random_buffers
from patchnet.training.evaluation.curves import TrackErrors, frame_errors, frame_orders

NAMES = ("optimal", "random", "ss-variance")


def scores_of(buffers: PixelBuffers) -> dict[str, np.ndarray]:
    return {name: STRATEGIES[name].scores(buffers) for name in NAMES}


def track_of(views: list[PixelBuffers]) -> TrackErrors:
    left = [frame_errors(buffers, frame_orders(buffers, scores_of(buffers))) for buffers in views]
    return TrackErrors(NAMES, np.array([buffers.active.sum() for buffers in views]), np.array(left))


def random_track(frames: int = 12, seed: int = 0, **size: int) -> TrackErrors:
    """Frames of different numbers of active pixels."""
    return track_of([random_buffers(seed + k, hits=0.02 + 0.4 * k / frames, **size) for k in range(frames)])
