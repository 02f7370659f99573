# SPDX-License-Identifier: GPL-3.0-or-later
"""Remaining error of the predicted picture, estimated without a further ray (methods 3.12b).

On its way behind the patch, the walk meets the fine voxel in the pixel's centre: one sample of what was predicted. The
pixels around say how much the picture changes there.
"""

from __future__ import annotations

import numpy as np

from .pixel_buffers import PixelBuffers

_NEIGHBOURS = ((0, 1), (1, -1), (1, 0), (1, 1))  # rows and columns from a pixel; the other four are seen from there


def remaining_error(buffers: PixelBuffers) -> np.ndarray:
    """s = sqrt((P - L_F)^2 + mean over 3x3 of (P_j - P)^2), (P,) float32, in units of luminance.

    P: the predicted picture. L_F: luminance of the finer ray; where the coarse one met nothing it is the background.
    """
    assert buffers.predicted is not None and buffers.fine is not None  # traced for the predicted picture
    sample = (buffers.predicted - buffers.fine) ** 2
    around = neighbour_difference(buffers.picture(buffers.predicted)).ravel()
    return np.sqrt(np.where(buffers.hit, sample, np.float32(0.0)) + around).astype(np.float32)


def neighbour_difference(picture: np.ndarray) -> np.ndarray:
    """Mean squared difference (H, W) float64 between each pixel of `picture` (H, W) and those of its 3x3 window.

    The pixel itself is one of them; at the picture's borders there are fewer than nine.
    """
    height, width = picture.shape
    values = picture.astype(np.float64)
    total, count = np.zeros((height, width)), np.ones((height, width))
    for down, right in _NEIGHBOURS:
        here = slice(0, height - down), slice(max(-right, 0), width - max(right, 0))
        there = slice(down, height), slice(max(right, 0), width - max(-right, 0))
        squared = (values[here] - values[there]) ** 2
        for part in (here, there):
            total[part] += squared
            count[part] += 1
    return np.asarray(total / count)
