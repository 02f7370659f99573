# SPDX-License-Identifier: GPL-3.0-or-later
"""Variance of the 3x3 window around every pixel of a picture, on all cores (methods 3.3)."""

import numpy as np

from ..runtime.kernels import kernel, lean_device
from ..runtime.threads import run_parts


def window_variance(picture: np.ndarray) -> np.ndarray:
    """Variance (H, W) float64 of the windows of a picture (H, W); at borders, only pixels of the picture count."""
    values = np.ascontiguousarray(picture, np.float32)
    variances = np.empty(values.shape)
    run_parts(_write_variances, len(values), values, variances)
    return variances


@kernel
def _write_variances(first, last, values, variances):  # type: ignore[no-untyped-def]
    height, width = values.shape
    for row in range(first, last):
        if 0 < row < height - 1 and width > 2:
            _write_inner(values[row - 1], values[row], values[row + 1], variances[row])
            variances[row, 0] = _at_border(values, row, 0)
            variances[row, width - 1] = _at_border(values, row, width - 1)
        else:
            for column in range(width):
                variances[row, column] = _at_border(values, row, column)


@lean_device
def _write_inner(below, here, above, variances):  # type: ignore[no-untyped-def]
    """Variances of whole windows of a row, without branches, so that they vectorize."""
    for x in range(1, len(here) - 1):
        total = np.float64(below[x - 1]) + below[x] + below[x + 1] + here[x - 1] + here[x] + here[x + 1]
        mean = (total + above[x - 1] + above[x] + above[x + 1]) / 9.0
        squares = (below[x - 1] - mean) ** 2 + (below[x] - mean) ** 2 + (below[x + 1] - mean) ** 2
        squares += (here[x - 1] - mean) ** 2 + (here[x] - mean) ** 2 + (here[x + 1] - mean) ** 2
        squares += (above[x - 1] - mean) ** 2 + (above[x] - mean) ** 2 + (above[x + 1] - mean) ** 2
        variances[x] = squares / 9.0


@lean_device
def _at_border(values, row, column):  # type: ignore[no-untyped-def]
    """Variance of a window that may reach outside of the picture."""
    low, high = max(row - 1, 0), min(row + 2, values.shape[0])
    left, right = max(column - 1, 0), min(column + 2, values.shape[1])
    count = (high - low) * (right - left)
    total, squares = 0.0, 0.0
    for y in range(low, high):
        for x in range(left, right):
            total += values[y, x]
    mean = total / count
    for y in range(low, high):
        for x in range(left, right):
            squares += (values[y, x] - mean) ** 2
    return squares / count
