# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture metrics at a budget, SSIM and MS-SSIM, for the main strategies (methods 5, 7.1).

Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity", IEEE TIP
13, 2004; Wang, Simoncelli, Bovik, "Multiscale structural similarity for image quality assessment", Asilomar 2003.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ...patchnet_addon.image.comparison import clamped
from ...patchnet_addon.image.tone import srgb_encode
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.refine import refined_mask, refined_picture

QUALITY_STRATEGIES = (
    "patchnet-plus", "patchnet-plus-1", "patchnet-plus-0", "patchnet", "patchnet-behind", "fusion", "ss-variance",
    "ss-variance-hits", "fine-ray", "fine-rays-4", "random", "optimal",
)  # fmt: skip
QUALITY_BUDGET = 0.3
_METRICS = ("ssim", "ssim_active", "ms_ssim")
QUALITY_NAMES = tuple(f"{name} {encoding}" for encoding in ("linear", "srgb") for name in _METRICS)
REACH_PX = 5  # of the window of SSIM, 11 x 11 pixels
SIDE_PX = 2 * REACH_PX + 1
SIGMA_PX = 1.5
C1, C2 = 0.01**2, 0.03**2  # (K1 L)^2 and (K2 L)^2 for the data range L = 1
SCALE_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)


def quality_of(buffers: PixelBuffers, orders: Mapping[str, np.ndarray]) -> np.ndarray:
    """(Q, M) float64, QUALITY_NAMES of the pictures that QUALITY_STRATEGIES refine within QUALITY_BUDGET.

    orders: (A,) by strategy, active pixels in the order of refinement. NaN in pictures smaller than SSIM's window.
    """
    if min(buffers.width, buffers.height) < SIDE_PX:
        return np.full((len(QUALITY_STRATEGIES), len(QUALITY_NAMES)), np.nan)
    masks = [refined_mask(buffers, orders[name], QUALITY_BUDGET) for name in QUALITY_STRATEGIES]
    return picture_metrics(buffers, np.array([buffers.picture(refined_picture(buffers, mask)) for mask in masks]))


def picture_metrics(buffers: PixelBuffers, pictures: np.ndarray) -> np.ndarray:
    """(N, M) float64, QUALITY_NAMES of pictures (N, H, W) of linear luminance, linear and sRGB-encoded.

    ssim_active is the mean of SSIM's map over active pixels, NaN without any.
    """
    assert buffers.reference is not None
    pictures, reference = clamped(pictures), clamped(buffers.picture(buffers.reference))
    active = buffers.picture(buffers.active)
    columns: list[np.ndarray] = []
    for encode in (np.asarray, srgb_encode):
        found = structure_of(encode(pictures), encode(reference))
        in_active = found.similarity[:, active].mean(axis=1) if active.any() else np.full(len(pictures), np.nan)
        columns += [found.ssim, in_active, found.ms_ssim]
    return np.stack(columns, axis=1)


class Structure(NamedTuple):
    """Structural similarity of N pictures with one reference.

    similarity: (N, H, W) float64, SSIM at each pixel, with mirrored borders. ssim: (N,) float64, its mean without a
    border of 5 pixels, whose windows leave the picture. ms_ssim: (N,) float64.
    """

    similarity: np.ndarray
    ssim: np.ndarray
    ms_ssim: np.ndarray


def structure_of(pictures: np.ndarray, reference: np.ndarray) -> Structure:
    """SSIM and multi-scale SSIM of pictures (N, H, W) with a reference (H, W), all in [0, 1].

    Each scale halves the one before by means of 2 x 2 pixels. Scales with a side below 11 pixels are omitted, and the
    weights of the others are normalized: 130 pixels allow 4 scales, 5 need 176. Negative means of a scale count as 0,
    since they have no real power. Pictures have at least the size of the window, 11 x 11 pixels.
    """
    x, y = pictures.astype(np.float64), reference.astype(np.float64)
    luminance, contrast = _parts(x, y)
    similarity = luminance * contrast
    scales = sum(min(reference.shape) >= SIDE_PX * 2**scale for scale in range(len(SCALE_WEIGHTS)))
    weights = SCALE_WEIGHTS[: max(scales, 1)]
    value = np.ones(len(x))
    for number, weight in enumerate(weights):
        if number:
            x, y = _halved(x), _halved(y)
            luminance, contrast = _parts(x, y)
        term = luminance * contrast if number == len(weights) - 1 else contrast
        value *= np.maximum(_inner_mean(term), 0.0) ** (weight / sum(weights))
    return Structure(similarity, _inner_mean(similarity), value)


def _parts(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Luminance term and contrast-structure term (N, H, W) of SSIM of pictures (N, H, W) with one (H, W)."""
    mean_x, mean_y = _blurred(x), _blurred(y)
    variances = _blurred(x * x) - mean_x**2 + (_blurred(y * y) - mean_y**2)
    covariance = _blurred(x * y) - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    return luminance, (2 * covariance + C2) / (variances + C2)


def _blurred(values: np.ndarray) -> np.ndarray:
    """Gaussian means (..., H, W) of the 11 x 11 pixels around each."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, SIGMA_PX, radius=REACH_PX, axes=(-2, -1)))


def _inner_mean(values: np.ndarray) -> np.ndarray:
    return np.asarray(values[..., REACH_PX:-REACH_PX, REACH_PX:-REACH_PX].mean(axis=(-2, -1)))


def _halved(values: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels; the last row or column of an odd side counts twice."""
    height, width = values.shape[-2:]
    even = np.pad(values, [(0, 0)] * (values.ndim - 2) + [(0, height % 2), (0, width % 2)], mode="edge")
    return np.asarray((even[..., ::2, ::2] + even[..., 1::2, ::2] + even[..., ::2, 1::2] + even[..., 1::2, 1::2]) / 4)
