# SPDX-License-Identifier: GPL-3.0-or-later
"""SSIM and MS-SSIM: structural similarity of two gray pictures, on one scale and on several (methods 5).

Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity", IEEE TIP
13, 2004; Wang, Simoncelli, Bovik, "Multiscale structural similarity for image quality assessment", Asilomar 2003.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.runtime.errors import SettingError

REACH_PX = 5  # of the 11 x 11 window
SIDE_PX = 2 * REACH_PX + 1
SIGMA_PX = 1.5
C1, C2 = 0.01**2, 0.03**2  # (K1 L)^2 and (K2 L)^2 for the data range L = 1
SCALE_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)


@dataclass(frozen=True, eq=False)
class Structure:
    """Structural similarity of N pictures with one reference.

    similarity: (N, H, W) float64, SSIM at each pixel; the pictures are mirrored at their border. ssim: (N,) float64,
    its mean without the 5 pixels at the border, whose windows are not in the picture. ms_ssim: (N,) float64.
    scales: that MS-SSIM was measured on, 5 or as many as fit into the picture.
    """

    similarity: np.ndarray
    ssim: np.ndarray
    ms_ssim: np.ndarray
    scales: int


def structure_of(pictures: np.ndarray, reference: np.ndarray) -> Structure:
    """SSIM and multi-scale SSIM of pictures (N, H, W) with a reference (H, W), all in [0, 1].

    Each scale halves the one before by means of 2 x 2 pixels. A scale whose shorter side would be below 11 pixels is
    left out, and the weights of the others are divided by their sum: 130 pixels hold 4 scales, 5 need 176. Negative
    means of a scale count as 0, since they have no real power.
    Raises SettingError for pictures of another shape, or smaller than the window of 11 x 11 pixels.
    """
    if pictures.shape[1:] != reference.shape or reference.ndim != 2:
        raise SettingError(
            f"SSIM compares gray pictures of one size, not of {pictures.shape[1:]} and {reference.shape}"
        )
    if min(reference.shape) < SIDE_PX:
        raise SettingError(
            f"SSIM needs {SIDE_PX} x {SIDE_PX} pixels, and the picture has {reference.shape}: render larger"
        )
    x, y = pictures.astype(np.float64), reference.astype(np.float64)
    luminance, contrast = _parts(x, y)
    similarity = luminance * contrast
    weights = SCALE_WEIGHTS[: _scales(min(reference.shape))]
    value = np.ones(len(x))
    for number, weight in enumerate(weights):
        if number:
            x, y = _halved(x), _halved(y)
            luminance, contrast = _parts(x, y)
        term = luminance * contrast if number == len(weights) - 1 else contrast
        value *= np.maximum(_inner_mean(term), 0.0) ** (weight / sum(weights))
    return Structure(similarity, _inner_mean(similarity), value, len(weights))


def _scales(side_px: int) -> int:
    """Number of scales, at least 1 and at most 5, that a side is wide enough for."""
    return max(sum(side_px >= SIDE_PX * 2**scale for scale in range(len(SCALE_WEIGHTS))), 1)


def _parts(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Luminance term and contrast-structure term (N, H, W) of SSIM of pictures (N, H, W) with one (H, W)."""
    mean_x, mean_y = _blurred(x), _blurred(y)
    variances = _blurred(x * x) - mean_x**2 + (_blurred(y * y) - mean_y**2)
    covariance = _blurred(x * y) - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    return luminance, (2 * covariance + C2) / (variances + C2)


def _blurred(values: np.ndarray) -> np.ndarray:
    """Gaussian means (..., H, W) of the 11 x 11 pixels around each."""
    from scipy.ndimage import correlate1d

    weights = np.exp(-0.5 * (np.arange(-REACH_PX, REACH_PX + 1) / SIGMA_PX) ** 2)
    weights /= weights.sum()
    return np.asarray(correlate1d(correlate1d(values, weights, axis=-2), weights, axis=-1))


def _inner_mean(values: np.ndarray) -> np.ndarray:
    return np.asarray(values[..., REACH_PX:-REACH_PX, REACH_PX:-REACH_PX].mean(axis=(-2, -1)))


def _halved(values: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels; the last row or column of an odd side counts twice."""
    height, width = values.shape[-2:]
    even = np.pad(values, [(0, 0)] * (values.ndim - 2) + [(0, height % 2), (0, width % 2)], mode="edge")
    return np.asarray((even[..., ::2, ::2] + even[..., 1::2, ::2] + even[..., ::2, 1::2] + even[..., 1::2, 1::2]) / 4)
