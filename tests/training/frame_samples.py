# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of noise with a preview and a reference, and their tracks, for tests of the evaluation."""

from types import SimpleNamespace

import numpy as np

from patchnet.patchnet_addon.sampling.pixel_buffers import PixelBuffers
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.training.evaluation.curves import TrackErrors, frame_errors, frame_orders

NAMES = ("optimal", "random", "ss-variance")


def random_frame(seed: int = 0, height: int = 17, width: int = 23, hits: float = 0.1) -> PixelBuffers:
    """A view of noise whose share `hits` of pixels are hit; missed ones are black in the preview."""
    rng = np.random.default_rng(seed)
    hit = rng.random(height * width) < hits
    preview = np.where(hit, rng.random(height * width), 0).astype(np.float32)
    reference = np.clip(preview + rng.normal(0, 0.2, height * width), 0, 1).astype(np.float32)
    first = SimpleNamespace(height_px=height, width_px=width, hit=hit, luminance=preview)
    return PixelBuffers(hits=first, reference=reference)


def scores_of(buffers: PixelBuffers) -> dict[str, np.ndarray]:
    return {name: STRATEGIES[name].scores(buffers) for name in NAMES}


def track_of(views: list[PixelBuffers]) -> TrackErrors:
    left = [frame_errors(buffers, frame_orders(buffers, scores_of(buffers))) for buffers in views]
    return TrackErrors(NAMES, np.array([buffers.active.sum() for buffers in views]), np.array(left))


def random_track(frames: int = 12, seed: int = 0, **size: int) -> TrackErrors:
    """Frames of different numbers of active pixels."""
    return track_of([random_frame(seed + k, hits=0.02 + 0.4 * k / frames, **size) for k in range(frames)])
