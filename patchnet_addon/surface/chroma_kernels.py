# SPDX-License-Identifier: GPL-3.0-or-later
"""Chroma for kernels; `chroma.py` defines it."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device, kernel
from .chroma import BLUE, GRAY_SHARE, GREEN, RED, SHARE_SCALE


@device
def decode_color(luminance, red, blue):
    """Compiled twin of `decoded_colors`, whose NumPy version defines the bytes."""
    r = float(red)
    b = float(blue)
    g = max(SHARE_SCALE - r - b, 0.0)
    scale = luminance / (RED * r + GREEN * g + BLUE * b)
    return r * scale, g * scale, b * scale


@device
def encode_shares(luminance, red, blue):
    """Compiled twin of `encoded_chroma_reference`, of a colour whose green is what is left of its luminance."""
    r = max(float(red), 0.0)
    b = max(float(blue), 0.0)
    g = max((luminance - RED * r - BLUE * b) / GREEN, 0.0)
    total = r + g + b
    if not total > 0.0:
        return np.uint8(GRAY_SHARE), np.uint8(GRAY_SHARE)
    return np.uint8(np.rint(r / total * SHARE_SCALE)), np.uint8(np.rint(b / total * SHARE_SCALE))


@kernel
def decode_colors(luminance: np.ndarray, chroma: np.ndarray) -> np.ndarray:
    """Luminance, red and blue (n, 3) float32 of luminance (n,) and chroma (n, 2) uint8."""
    colors = np.empty((len(luminance), 3), np.float32)
    for i in range(len(luminance)):
        red, _, blue = decode_color(float(luminance[i]), chroma[i, 0], chroma[i, 1])
        colors[i, 0], colors[i, 1], colors[i, 2] = luminance[i], red, blue
    return colors


@kernel
def encode_chroma(luminance: np.ndarray, red_blue: np.ndarray) -> np.ndarray:
    """Stored chroma (n, 2) uint8 of luminance (n,), red and blue (n, 2), of any brightness."""
    stored = np.empty((len(luminance), 2), np.uint8)
    for i in range(len(luminance)):
        stored[i, 0], stored[i, 1] = encode_shares(float(luminance[i]), red_blue[i, 0], red_blue[i, 1])
    return stored
