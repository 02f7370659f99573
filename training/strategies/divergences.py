# SPDX-License-Identifier: GPL-3.0-or-later
"""f-divergences of luminance in a 3x3 window from uniform, by Rigau, Feixas and Sbert (methods 3.6)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import Strategy
from .distribution import WindowDistribution, luminance_distribution


def kullback_leibler(distribution: WindowDistribution) -> np.ndarray:
    """Kullback-Leibler divergence from uniform, sum p ln(N p) = ln N - H(p), of each window (H, W), in nats."""
    ratio = distribution.ratio
    logarithm = np.log(np.where(ratio > 0, ratio, 1.0))
    return np.maximum(distribution.average(ratio * logarithm), 0.0)  # rounding may go below 0


def chi_square(distribution: WindowDistribution) -> np.ndarray:
    """Chi-square divergence from uniform, N sum p^2 - 1, of each window (H, W)."""
    return distribution.average((distribution.ratio - 1.0) ** 2)


def squared_hellinger(distribution: WindowDistribution) -> np.ndarray:
    """Squared Hellinger distance to uniform, 1 - sum sqrt(p / N), of each window (H, W), in [0, 1]."""
    return distribution.average((np.sqrt(distribution.ratio) - 1.0) ** 2) / 2.0


def _strategy(
    name: str,
    title: str,
    divergence: Callable[[WindowDistribution], np.ndarray],
    words: str,
    maximum: float,
    root: bool = False,
) -> Strategy:
    def score(buffers: PixelBuffers) -> np.ndarray:
        distribution = luminance_distribution(buffers)
        amount = divergence(distribution)
        return (distribution.mean * (np.sqrt(amount) if root else amount)).ravel()

    return Strategy(
        name=name,
        title=title,
        description=f"Mean luminance times the {words} of the 3x3 pixels around from uniform luminance",
        needs=frozenset(),
        score=score,
        quantity="luminance x divergence",
        maximum=maximum,
        group="screen-space",
    )


STRATEGIES = (
    _strategy("kl", "Kullback-Leibler", kullback_leibler, "Kullback-Leibler divergence", 0.25),
    _strategy("chi2", "Chi-square", chi_square, "chi-square divergence", 0.5),
    _strategy("chi2-root", "Chi-square, root", chi_square, "root of the chi-square divergence", 0.5, root=True),
    _strategy("hellinger", "Hellinger", squared_hellinger, "squared Hellinger distance", 0.1),
    _strategy("hellinger-root", "Hellinger, root", squared_hellinger, "Hellinger distance", 0.25, root=True),
)
