# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance to the user: a weight in [0, 1] for every pixel, which multiplies its priority.

A pixel of weight 0 is never refined. Errors still count all active pixels, so reported figures include unrefined ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class PixelRect(NamedTuple):
    """Rectangle of a picture within a view, in pixels from the view's lower left; it may reach beyond the view."""

    left: int
    bottom: int
    width: int
    height: int


def picture_weights(values: np.ndarray, height: int, width: int, rect: PixelRect | None = None) -> np.ndarray:
    """(height * width,) float32: weights painted on a picture (h, w) of any size, stretched over the view.

    rect: area to stretch it over instead; pixels outside weigh 0.

    Bilinear; where the painted picture has more pixels than the view, each pixel takes the mean of those under a
    triangle two pixels wide, so that thin strokes count. Values are clamped to [0, 1]; values that are not finite
    become 0.
    """
    values = np.clip(np.nan_to_num(np.asarray(values, np.float32), posinf=1.0, neginf=0.0), 0.0, 1.0)
    rect = rect or PixelRect(0, 0, width, height)
    rows = _bilinear(values.shape[0], rect.height, -rect.bottom, height)
    columns = _bilinear(values.shape[1], rect.width, -rect.left, width)
    resized = rows @ values @ columns.T
    return np.clip(resized, 0.0, 1.0).astype(np.float32).ravel()


def _bilinear(before: int, after: int, first: int, count: int) -> np.ndarray:
    """(count, before) float32: rows from `first` on of the (after, before) matrix that resizes an axis.

    Rows sum to 1, edges are repeated; rows outside the matrix are 0.
    """
    scale = before / after
    pixel = first + np.arange(count)
    centre = (pixel + 0.5) * scale - 0.5
    reach = max(scale, 1.0)
    if scale <= 1.0:
        centre = np.clip(centre, 0.0, before - 1.0)
    weights = np.maximum(1.0 - np.abs(centre[:, None] - np.arange(before)) / reach, 0.0)
    there = ((pixel >= 0) & (pixel < after))[:, None]
    return (np.where(there, weights, 0.0) / np.where(there, weights.sum(axis=1, keepdims=True), 1.0)).astype(np.float32)


def beside_hits(weights: np.ndarray, hit: np.ndarray) -> np.ndarray:
    """(H, W) float32: weights (H, W) of hit pixels; pixels without a hit take the largest among their 8 neighbours.

    Beside a silhouette such pixels are active and have errors (methods 7.23).
    """
    known = np.where(hit, weights, np.float32(0.0)).astype(np.float32)
    padded = np.pad(known, 1)
    rows = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    largest = np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
    return np.where(hit, known, largest)
