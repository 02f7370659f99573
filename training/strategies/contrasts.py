# SPDX-License-Identifier: GPL-3.0-or-later
"""Screen-space scores of the 3x3 pixels around each pixel: variance of hits, contrasts, entropies, f-divergences.

Mitchell's contrast (methods 3.4), the entropy contrasts (3.5) and f-divergences (3.6) of Rigau, Feixas and Sbert, and
the Tsallis entropy contrast of Xu, Sbert, Xing and Zhang (3.7). The last three compare the distribution p of luminance
in a window with a uniform one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...patchnet_addon.sampling import ss_variance
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import NORMAL, Strategy

EPSILON = 1e-6  # windows with a smaller sum of luminance are black
LUMINANCE_SHARE = 0.5  # delta of methods 3.5
INDICES = (0.5, 1.5, 2.0, 3.0)  # of Tsallis' entropy: the paper does not state its index
_TINY = float(np.finfo(np.float64).tiny)
_NEAREST = float(np.finfo(np.float32).tiny)  # least distance, for a camera in a leaf; its square is above 0
_CHI2, _HELLINGER = "chi-square divergence from uniform luminance", "Hellinger distance to uniform luminance"


def windows(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (H, W, 9) of the windows of `picture` (H, W), and a mask (H, W, 9) bool of the values inside the picture.

    Values outside the picture are 0. A window is in row-major order, its pixel at index 4.
    """
    padded = np.pad(picture, 1), np.pad(np.ones(picture.shape, bool), 1)
    values, inside = (sliding_window_view(plane, (3, 3)).reshape(*picture.shape, 9) for plane in padded)
    return values, inside


@dataclass(frozen=True, eq=False)
class WindowDistribution:
    """Distribution p_i = w_i / sum w of weights over the N pixels of each window inside the picture.

    inside: (H, W, 9) bool, pixels in the picture. count: (H, W), N, their number. mean: (H, W) float64, mean weight.
    ratio: (H, W, 9) float64, N p_i, the weights over their mean; 1 in windows without weight, which count as uniform,
    and 0 outside the picture.

    Contrasts are sums over these ratios instead of p_i: in uniform windows they are exactly 1, so that all uniform
    windows score exactly 0 and tie for any N.
    """

    inside: np.ndarray
    count: np.ndarray
    mean: np.ndarray
    ratio: np.ndarray

    @classmethod
    def of(cls, weights: np.ndarray, least: float) -> WindowDistribution:
        """Distributions in a picture of weights (H, W) >= 0; windows whose sum is below `least` count as uniform."""
        values, inside = windows(weights.astype(np.float64))
        count = inside.sum(axis=-1)  # 9, fewer at the picture's borders
        total = values.sum(axis=-1)
        mean = total / count
        there = total >= least
        ratio = np.where(there[..., None], values / np.where(there, mean, 1.0)[..., None], 1.0)
        return cls(inside, count, mean, np.where(inside, ratio, 0.0))

    def average(self, values: np.ndarray) -> np.ndarray:
        """Mean (H, W) of values (H, W, 9) over the window's pixels in the picture."""
        return np.where(self.inside, values, 0.0).sum(axis=-1) / self.count


Contrast = Callable[[WindowDistribution], np.ndarray]
"""Contrast (H, W) of the distribution in each window."""


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


def entropy_contrast(distribution: WindowDistribution) -> np.ndarray:
    """Entropy contrast C = 1 - H / ln N of each window (H, W), H = -sum p ln p; 0 for a single pixel. It is 0 in
    uniform windows and 1 where one pixel has all the weight (equation 7 of methods 3.5).
    """
    most = np.log(distribution.count)
    return kullback_leibler(distribution) / np.where(most > 0, most, 1.0)  # (ln N - H) / ln N


def tsallis_contrast(distribution: WindowDistribution, q: float) -> np.ndarray:
    """Tsallis contrast 1 - H_q / H_q_max of each window (H, W), in [0, 1]; H_q = (1 - sum p^q) / (q - 1).

    q: entropic index above 0, not 1, the limit of Shannon's entropy. A window of one pixel has contrast 0.
    """
    # The definition with p = r / N, without cancellation: exactly 0 for uniform r = 1.
    most = distribution.count ** (q - 1.0) - 1.0
    contrast = (distribution.average(distribution.ratio**q) - 1.0) / np.where(most != 0, most, 1.0)
    return np.maximum(contrast, 0.0)  # rounding may go below 0


def geometry_contrast(buffers: PixelBuffers) -> np.ndarray:
    """Entropy contrast (H, W) of cos / d^2 in each window; d: distance of the hit, cos: |N_V . w| (equations 9, 10).
    Misses have p = 0; a window without hits has no contrast.
    """
    assert buffers.normal is not None  # required by `needs`
    hits = buffers.hits
    cosine = np.abs(np.einsum("pc,pc->p", buffers.normal.astype(np.float64), hits.direction))
    distance = np.maximum(hits.t_world.astype(np.float64), _NEAREST)
    # Distances are in scene units: any small weight counts.
    return entropy_contrast(WindowDistribution.of(buffers.picture(cosine / distance**2), _TINY))


def luminance_contrast(buffers: PixelBuffers, contrast: Contrast) -> np.ndarray:
    """Contrast times mean luminance of each window of the preview, (H, W); black windows count as uniform."""
    distribution = WindowDistribution.of(buffers.picture(buffers.preview), EPSILON)
    return distribution.mean * contrast(distribution)


def _mitchell(buffers: PixelBuffers) -> np.ndarray:
    values, inside = windows(buffers.picture(buffers.preview.astype(np.float64)))
    most = np.where(inside, values, -np.inf).max(axis=-1)
    least = np.where(inside, values, np.inf).min(axis=-1)
    total = most + least
    return np.where(total < EPSILON, 0.0, (most - least) / np.maximum(total, EPSILON)).ravel()


def _geometry_score(buffers: PixelBuffers) -> np.ndarray:
    luminance, geometry = luminance_contrast(buffers, entropy_contrast), geometry_contrast(buffers)
    return (LUMINANCE_SHARE * luminance + (1.0 - LUMINANCE_SHARE) * geometry).ravel()


def _by_contrast(name: str, title: str, words: str, contrast: Contrast, maximum: float) -> Strategy:
    """Strategy whose score is a contrast of luminance times mean luminance (equation 8 of methods 3.5)."""

    def score(buffers: PixelBuffers) -> np.ndarray:
        return luminance_contrast(buffers, contrast).ravel()

    description = f"Mean luminance times the {words} in the 3x3 pixels around"
    return Strategy(name, title, description, frozenset(), score, "luminance x contrast", maximum)


def tsallis(q: float) -> Strategy:
    """Tsallis strategy of an entropic index q, called `tsallis-q`: mean luminance times contrast."""
    title = f"Tsallis entropy, q = {q:g}"
    words = "Tsallis entropy contrast of luminance"
    return _by_contrast(f"tsallis-{q:g}", title, words, lambda seen: tsallis_contrast(seen, q), 0.2)


def _root_of(divergence: Contrast) -> Contrast:
    return lambda distribution: np.sqrt(divergence(distribution))


STRATEGIES = (
    # Network and look-up table cannot rank pixels without a hit: with the same limitation variance shows their value.
    Strategy(
        "ss-variance-hits",
        "Screen-space variance of hits",
        "Variance of luminance in the 3x3 pixels around; 0 in pixels without a hit",
        frozenset(),
        lambda buffers: np.where(buffers.hit, ss_variance.STRATEGY.score(buffers), 0.0),
        "variance of luminance",
        0.05,
    ),
    Strategy(
        "mitchell",
        "Mitchell contrast",
        "Contrast of luminance, (most - least) / (most + least), in the 3x3 pixels around",
        frozenset(),
        _mitchell,
        "contrast",
        1.0,
    ),
    _by_contrast("entropy", "Entropy, luminance", "entropy contrast of luminance", entropy_contrast, 0.2),
    Strategy(
        "entropy-geometry",
        "Entropy, luminance and geometry",
        "Half the entropy contrast of luminance, half that of distance and slope, in the 3x3 pixels around",
        frozenset({NORMAL}),
        _geometry_score,
        "contrast",
        0.5,
    ),
    _by_contrast("kl", "Kullback-Leibler", "divergence from uniform luminance", kullback_leibler, 0.25),
    _by_contrast("chi2", "Chi-square", _CHI2, chi_square, 0.5),
    _by_contrast("chi2-root", "Chi-square, root", f"root of the {_CHI2}", _root_of(chi_square), 0.5),
    _by_contrast("hellinger", "Hellinger", f"squared {_HELLINGER}", squared_hellinger, 0.1),
    _by_contrast("hellinger-root", "Hellinger, root", _HELLINGER, _root_of(squared_hellinger), 0.25),
    *(tsallis(q) for q in INDICES),
)
