# SPDX-License-Identifier: GPL-3.0-or-later
"""f-divergences of luminance in a 3x3 window from uniform, by Rigau, Feixas and Sbert (methods 3.6)."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.sampling.strategy import Strategy
from .distribution import Contrast, WindowDistribution, contrast_strategy


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


def _root_of(divergence: Contrast) -> Contrast:
    return lambda distribution: np.sqrt(divergence(distribution))


def _strategy(name: str, title: str, words: str, divergence: Contrast, maximum: float) -> Strategy:
    description = f"Mean luminance times the {words} of the 3x3 pixels around from uniform luminance"
    return contrast_strategy(name, title, description, divergence, maximum, "luminance x divergence")


STRATEGIES = (
    _strategy("kl", "Kullback-Leibler", "Kullback-Leibler divergence", kullback_leibler, 0.25),
    _strategy("chi2", "Chi-square", "chi-square divergence", chi_square, 0.5),
    _strategy("chi2-root", "Chi-square, root", "root of the chi-square divergence", _root_of(chi_square), 0.5),
    _strategy("hellinger", "Hellinger", "squared Hellinger distance", squared_hellinger, 0.1),
    _strategy("hellinger-root", "Hellinger, root", "Hellinger distance", _root_of(squared_hellinger), 0.25),
)
