# SPDX-License-Identifier: GPL-3.0-or-later
"""Predicted picture: the network's expected luminance of each pixel, for one further ray a pixel (methods 3.12b)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..codes.prediction import Prediction

PREVIEW, PREDICTED = "preview", "predicted"  # picture shown in unrefined pixels
UNREFINED = (PREVIEW, PREDICTED)


def expected_luminance(patch: Prediction, behind: np.ndarray) -> np.ndarray:
    """Luminance P = sigma L_N + (1 - sigma) L_B, (P,) float32, of a patch over the luminance `behind` it (P,).

    It equals the preview for a miss and without look-ahead, where patches are whole (methods 4.1b).
    """
    return patch.coverage * patch.luminance + (1.0 - patch.coverage) * behind


def expected_colors(
    patch: Prediction, luminance: np.ndarray, colors: np.ndarray, behind_colors: np.ndarray
) -> np.ndarray:
    """Linear colours sigma C_V L_N / L_V + (1 - sigma) C_B, (P, 3) float32, whose luminance is `expected_luminance`.

    luminance, colors: L_V (P,) and C_V (P, 3) of the voxel. behind_colors: C_B (P, 3). The network predicts no hue, so
    the patch takes that of its voxel; the patch of a black voxel is gray.
    """
    lit = luminance > 0.0
    scale = np.divide(patch.luminance, luminance, out=np.zeros_like(patch.luminance), where=lit)
    patch_colors = np.where(lit[:, None], scale[:, None] * colors, patch.luminance[:, None])
    coverage = patch.coverage[:, None]
    return (coverage * patch_colors + (1.0 - coverage) * behind_colors).astype(np.float32)
