# SPDX-License-Identifier: GPL-3.0-or-later
"""Fusion of an expected luminance error with screen-space variance: s^2 = e^2 + variance / 4 (methods 10)."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.sampling import patchnet_behind, ss_variance
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import Strategy
from . import fine_rays

SHARE = 0.25  # share of the variance of 3x3 pixels that estimates the pixel's own


def with_variance(strategy: Strategy, name: str, title: str) -> Strategy:
    """Strategy that adds SS-Variance to a strategy whose score is a luminance difference."""

    def score(buffers: PixelBuffers) -> np.ndarray:
        expected = np.asarray(strategy.score(buffers), np.float64)
        return np.sqrt(expected**2 + SHARE * ss_variance.STRATEGY.score(buffers))

    return Strategy(
        name=name,
        title=title,
        description=f"{strategy.title}, and the variance of luminance in the 3x3 pixels around",
        needs=strategy.needs,
        score=score,
        quantity="expected luminance error",
        maximum=strategy.maximum,
        group=strategy.group,
        extra_rays=strategy.extra_rays,
    )


FUSION = with_variance(patchnet_behind.STRATEGY, "fusion", "PatchNet Behind and variance")
FINE_RAY = with_variance(fine_rays.FINE_RAY, "fine-ray-variance", "One finer ray and variance")
FINE_RAYS_4 = with_variance(fine_rays.FINE_RAYS_4, "fine-rays-4-variance", "Four finer rays and variance")

STRATEGIES = FUSION, FINE_RAY, FINE_RAYS_4
