# SPDX-License-Identifier: GPL-3.0-or-later
"""Entropy contrast of luminance and of geometry in a 3x3 window, by Rigau, Feixas and Sbert (methods 3.5)."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import NORMAL, Strategy
from .distribution import WindowDistribution, contrast_strategy, luminance_contrast
from .divergences import kullback_leibler

LUMINANCE_SHARE = 0.5  # delta of methods 3.5
_TINY = float(np.finfo(np.float64).tiny)
_NEAREST = float(np.finfo(np.float32).tiny)  # least distance, for a camera in a leaf; its square is above 0


def entropy_contrast(distribution: WindowDistribution) -> np.ndarray:
    """Entropy contrast C = 1 - H / ln N of each window (H, W), H = -sum p ln p; 0 for a single pixel. It is 0 in
    uniform windows and 1 where one pixel has all the weight (equation 7 of methods 3.5).
    """
    most = np.log(distribution.count)
    return kullback_leibler(distribution) / np.where(most > 0, most, 1.0)  # (ln N - H) / ln N


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


def _geometry_score(buffers: PixelBuffers) -> np.ndarray:
    luminance, geometry = luminance_contrast(buffers, entropy_contrast), geometry_contrast(buffers)
    return (LUMINANCE_SHARE * luminance + (1.0 - LUMINANCE_SHARE) * geometry).ravel()


STRATEGIES = (
    contrast_strategy(
        "entropy",
        "Entropy, luminance",
        "Mean luminance times the entropy contrast of luminance in the 3x3 pixels around",
        entropy_contrast,  # equation 8 of methods 3.5 with one channel
        maximum=0.2,
    ),
    Strategy(
        name="entropy-geometry",
        title="Entropy, luminance and geometry",
        description="Half the entropy contrast of luminance, half that of distance and slope, in the 3x3 pixels around",
        needs=frozenset({NORMAL}),
        score=_geometry_score,
        quantity="contrast",
        maximum=0.5,
        group="screen-space",
    ),
)
