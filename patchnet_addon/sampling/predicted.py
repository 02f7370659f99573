# SPDX-License-Identifier: GPL-3.0-or-later
"""Predicted picture: what the network expects each pixel to show, for one further ray a pixel (methods 3.12b)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..runtime.errors import SettingError

if TYPE_CHECKING:
    from ..codes.predict import Prediction

PREVIEW, PREDICTED = "preview", "predicted"  # what pixels show that are not refined
UNREFINED = (PREVIEW, PREDICTED)


def check_unrefined(name: str) -> str:
    """Name of what pixels show that are not refined, as it was given; raises SettingError if there is no such."""
    if name not in UNREFINED:
        raise SettingError(f"Unrefined pixels cannot show {name!r}: choose one of {', '.join(UNREFINED)}")
    return name


def expected_luminance(patch: Prediction, behind: np.ndarray) -> np.ndarray:
    """Luminance P = sigma L_N + (1 - sigma) L_B, (P,) float32, of a patch before what shows `behind` it (P,).

    That is the preview's where the ray met nothing, or there is no look-ahead: patches are whole there (methods 4.1b).
    """
    return patch.coverage * patch.luminance + (1.0 - patch.coverage) * behind


def expected_colors(
    patch: Prediction, luminance: np.ndarray, colors: np.ndarray, behind_colors: np.ndarray
) -> np.ndarray:
    """Linear colours sigma C_V L_N / L_V + (1 - sigma) C_B, (P, 3) float32, whose luminance is `expected_luminance`.

    luminance, colors: L_V (P,) and C_V (P, 3) of the voxel. behind_colors: C_B (P, 3). The network knows no hue, so the
    patch has that of its voxel; the patch of a black voxel, which has none, is gray.
    """
    lit = luminance > 0.0
    scale = np.divide(patch.luminance, luminance, out=np.zeros_like(patch.luminance), where=lit)
    patch_colors = np.where(lit[:, None], scale[:, None] * colors, patch.luminance[:, None])
    coverage = patch.coverage[:, None]
    return (coverage * patch_colors + (1.0 - coverage) * behind_colors).astype(np.float32)
