# SPDX-License-Identifier: GPL-3.0-or-later
"""Chroma kernels: colour to and from two bytes; `chroma` is the NumPy version and defines the bytes."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device
from .chroma import BLUE, GRAY_SHARE, GREEN, RED, SHARE_SCALE


@device
def decode_color(luminance, red, blue):  # type: ignore[no-untyped-def]
    """Compiled twin of `decoded_colors`."""
    r = float(red)
    b = float(blue)
    g = max(SHARE_SCALE - r - b, 0.0)
    scale = luminance / (RED * r + GREEN * g + BLUE * b)
    return r * scale, g * scale, b * scale


@device
def encode_shares(luminance, red, blue):  # type: ignore[no-untyped-def]
    """Compiled twin of `encoded_chroma_reference`, of a colour whose green is what is left of its luminance."""
    r = max(float(red), 0.0)
    b = max(float(blue), 0.0)
    g = max((luminance - RED * r - BLUE * b) / GREEN, 0.0)
    total = r + g + b
    if not total > 0.0:
        return np.uint8(GRAY_SHARE), np.uint8(GRAY_SHARE)
    return np.uint8(np.rint(r / total * SHARE_SCALE)), np.uint8(np.rint(b / total * SHARE_SCALE))
