# SPDX-License-Identifier: GPL-3.0-or-later
"""Catmull-Rom spline through points at given times (Catmull and Rom 1974)."""

from __future__ import annotations

import numpy as np


def catmull_rom(times: np.ndarray, points: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values (N, C) at times `wanted` (N,) of the spline through points (K, C) at ascending times (K,).

    Tangents are those of finite differences over uneven times; at both ends they are those of the straight piece there.
    One point stays where it is.
    """
    if len(points) == 1:
        return np.repeat(points, len(wanted), axis=0)
    tangents = np.gradient(points, times, axis=0)  # (K, C)
    piece = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
    length = (times[piece + 1] - times[piece])[:, None]
    s = (wanted - times[piece])[:, None] / length
    result: np.ndarray = (
        (2 * s**3 - 3 * s**2 + 1) * points[piece]
        + (s**3 - 2 * s**2 + s) * length * tangents[piece]
        + (3 * s**2 - 2 * s**3) * points[piece + 1]
        + (s**3 - s**2) * length * tangents[piece + 1]
    )
    return result
