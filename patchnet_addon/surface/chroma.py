# SPDX-License-Identifier: GPL-3.0-or-later
"""Chroma beside luminance, two bytes per node: the shares of red and of blue in red + green + blue.

A decoded colour has exactly the node's luminance. 255 is all; gray, a third of each, is 85 and so exact. Near gray,
rounding to bytes changes a channel by at most 1.3 %, about one of the 255 grades of a screen. Colours are linear Rec.
709 (methods 7.2d).
"""

from __future__ import annotations

import numpy as np

RED, GREEN, BLUE = 0.2126, 0.7152, 0.0722  # of luminance
REC709 = np.array([RED, GREEN, BLUE], np.float32)
# Numbers that one of a colour is taken for: a channel's place in it, and weights of red, green and blue.
CHANNELS = {"R": 0, "G": 1, "B": 2, "A": 3}
CHANNEL_WEIGHTS = {"Y": REC709, "MEAN": np.full(3, 1.0 / 3.0, np.float32)}
SHARE_SCALE = 255.0
GRAY_SHARE = 85


def decoded_colors(luminance: np.ndarray, chroma: np.ndarray) -> np.ndarray:
    """Linear colours (n, 3) float32 of luminance (n,) and chroma (n, 2) uint8; channels may be above 1."""
    red, blue = (chroma[..., channel].astype(np.float64) for channel in range(2))
    colors = np.stack([red, np.maximum(SHARE_SCALE - red - blue, 0.0), blue], axis=-1)
    scale = np.asarray(luminance, np.float64) / (colors @ (RED, GREEN, BLUE))
    return (colors * scale[..., None]).astype(np.float32)
