# SPDX-License-Identifier: GPL-3.0-or-later
"""Variance of the 3x3 window around every pixel of a picture, on all cores (methods 3.3)."""

import numpy as np

from ..runtime.kernels import kernel
from ..runtime.threads import run_parts


def window_variance(picture: np.ndarray) -> np.ndarray:
    """Variance (H, W) float64 of the windows of a picture (H, W); at borders, only pixels of the picture count."""
    values = np.ascontiguousarray(picture, np.float32)
    variances = np.empty(values.shape)
    run_parts(_write_variances, len(values), values, variances)
    return variances


@kernel
def _write_variances(first: int, last: int, values: np.ndarray, variances: np.ndarray) -> None:
    height, width = values.shape
    for row in range(first, last):
        low, high = max(row - 1, 0), min(row + 2, height)
        for column in range(width):
            left, right = max(column - 1, 0), min(column + 2, width)
            count = (high - low) * (right - left)
            total, squares = 0.0, 0.0
            for y in range(low, high):
                for x in range(left, right):
                    total += values[y, x]
            mean = total / count
            for y in range(low, high):
                of_row = 0.0
                for x in range(left, right):
                    of_row += (values[y, x] - mean) ** 2
                squares += of_row
            variances[row, column] = squares / count
