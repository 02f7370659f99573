# SPDX-License-Identifier: GPL-3.0-or-later
"""Means over the rays of pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class PixelMeans(NamedTuple):
    """Means over side x side rays of N pixels, over a black background.

    luminance: (N,) float32. colors: (N, 3) float32 linear. coverage: (N,) float32, share of the rays that hit.
    """

    luminance: np.ndarray
    colors: np.ndarray
    coverage: np.ndarray
