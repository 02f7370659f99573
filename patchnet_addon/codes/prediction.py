# SPDX-License-Identifier: GPL-3.0-or-later
"""Coverage and luminance that a network, or the patch itself, gives for each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction for each of P pixels.

    coverage: (P,) float32, sigma, share of the pixel that the patch covers; 1 without look-ahead.
    luminance: (P,) float32, L_N, mean luminance of that share; that of the preview without look-ahead. look_ahead: (P,)
    bool, the hit voxel has descendants at the patch's depth (methods 4.1b); false for misses.
    """

    coverage: np.ndarray
    luminance: np.ndarray
    look_ahead: np.ndarray

    def __getitem__(self, pixels: np.ndarray) -> Prediction:
        """Prediction for pixels by index (N,)."""
        return Prediction(self.coverage[pixels], self.luminance[pixels], self.look_ahead[pixels])
