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


@dataclass(frozen=True)
class MultiScale:
    """MS-SSIM, and the number of scales that it was measured on: 5, or as many as fit into the picture."""

    value: float
    scales: int


def ssim_map(picture: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """SSIM (H, W) float64 at each pixel of two pictures (H, W) in [0, 1]; the picture is mirrored at its border.

    Raises SettingError for pictures of different shapes, or smaller than the window of 11 x 11 pixels.
    """
    luminance, contrast = _parts(picture, reference)
    return luminance * contrast


def ssim(similarity: np.ndarray) -> float:
    """Mean SSIM of a map (H, W), without the 5 pixels at the border, whose windows are not in the picture."""
    return float(_inner(similarity).mean())


def ms_ssim(picture: np.ndarray, reference: np.ndarray) -> MultiScale:
    """Multi-scale SSIM of two pictures (H, W) in [0, 1]; raises SettingError as `ssim_map`.

    Each scale halves the one before by means of 2 x 2 pixels. A scale whose shorter side would be below 11 pixels is
    left out, and the weights of the others are divided by their sum: 130 pixels hold 4 scales, 5 need 176. Negative
    means of a scale count as 0, since they have no real power.
    """
    value, weights = 1.0, SCALE_WEIGHTS[: _scales(min(picture.shape))]
    for number, weight in enumerate(weights):
        luminance, contrast = _parts(picture, reference)
        similarity = luminance * contrast if number == len(weights) - 1 else contrast
        value *= max(float(_inner(similarity).mean()), 0.0) ** (weight / sum(weights))
        picture, reference = _halved(picture), _halved(reference)
    return MultiScale(value, len(weights))


def _scales(side_px: int) -> int:
    """Number of scales, at least 1 and at most 5, that a side is wide enough for."""
    return max(sum(side_px >= SIDE_PX * 2**scale for scale in range(len(SCALE_WEIGHTS))), 1)


def _parts(picture: np.ndarray, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Luminance term and contrast-structure term of SSIM, (H, W) float64 each."""
    if picture.shape != reference.shape or picture.ndim != 2:
        raise SettingError(f"SSIM compares gray pictures of one size, not of {picture.shape} and {reference.shape}")
    if min(picture.shape) < SIDE_PX:
        raise SettingError(
            f"SSIM needs {SIDE_PX} x {SIDE_PX} pixels, and the picture has {picture.shape}: render larger"
        )
    x, y = picture.astype(np.float64), reference.astype(np.float64)
    mean_x, mean_y = _blurred(x), _blurred(y)
    variances = _blurred(x * x) - mean_x**2 + _blurred(y * y) - mean_y**2
    covariance = _blurred(x * y) - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    return luminance, (2 * covariance + C2) / (variances + C2)


def _blurred(values: np.ndarray) -> np.ndarray:
    """Gaussian mean (H, W) of the 11 x 11 pixels around each."""
    weights = np.exp(-0.5 * (np.arange(-REACH_PX, REACH_PX + 1) / SIGMA_PX) ** 2)
    weights /= weights.sum()
    height, width = values.shape
    padded = np.pad(values, REACH_PX, mode="symmetric")
    rows = sum(weight * padded[k : k + height] for k, weight in enumerate(weights))
    return np.asarray(sum(weight * rows[:, k : k + width] for k, weight in enumerate(weights)))


def _inner(values: np.ndarray) -> np.ndarray:
    return values[REACH_PX:-REACH_PX, REACH_PX:-REACH_PX]


def _halved(values: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels; the last row or column of an odd side counts twice."""
    height, width = values.shape
    even = np.pad(values, [(0, height % 2), (0, width % 2)], mode="edge")
    return (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]) / 4
