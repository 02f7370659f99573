# SPDX-License-Identifier: GPL-3.0-or-later
"""Tone mapping: linear light to sRGB for display."""

import numpy as np


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """sRGB transfer function of linear values, float32, clamped to [0, 1] (IEC 61966-2-1)."""
    value = np.clip(np.nan_to_num(np.asarray(linear, np.float32)), 0.0, 1.0)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** np.float32(1 / 2.4) - 0.055).astype(np.float32)


def to_bytes(encoded: np.ndarray) -> np.ndarray:
    """Encoded values in [0, 1] as uint8, rounded to nearest."""
    return np.round(np.clip(encoded, 0.0, 1.0) * 255.0).astype(np.uint8)


def gray(luminance: np.ndarray) -> np.ndarray:
    """Linear luminance (H, W) as an sRGB picture (H, W, 3) float32 in [0, 1]."""
    return np.repeat(srgb_encode(luminance)[..., None], 3, axis=-1)
