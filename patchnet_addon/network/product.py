# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products of the encoder's layers: float32, with bias and ReLU, independent of NumPy's BLAS.

Sums of four rows times two vectors of columns stay in registers. A matrix is packed once into panels of as many
columns, which a core keeps in its nearest cache for a block of rows. Columns that are zero in all four rows are
skipped: most cells of a block are empty, and ReLU zeroes most values of a layer.

A sum adds its terms in the order of columns. So a row has the same bits for any neighbours, order and number of
threads; only processors without fused multiply-add have others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device
from ..runtime.vectors import larger, store
from .encoders import CHANNELS, LUMINANCE, octant_matrices
from .simd import LANES, add_product, load, spread
from .weights import Weights

WIDTH = 2 * LANES  # columns of a panel
ROWS = 4  # eight vectors of sums: with five or six rows the compiler runs out of registers, at half the speed


class PackedLayers(NamedTuple):
    """Layers of the encoder in panels of WIDTH columns, the last one zero-padded, for kernels.

    octants: (8 * P, B, WIDTH) of the first layer, octant by octant. first_bias: (256,). panels: (Q, 256, WIDTH) of
    further layers, concatenated. bias: (Q * WIDTH,) of these. least: (2,) the smallest result of a layer, and of the
    last. sees_luminance: whether luminance has nonzero weights; a luminance mixture encodes shape only.
    """

    octants: np.ndarray
    first_bias: np.ndarray
    panels: np.ndarray
    bias: np.ndarray
    least: np.ndarray
    sees_luminance: bool

    @classmethod
    def pack(cls, weights: Weights) -> PackedLayers:
        """Layers of these weights for the kernels of `encode_octree`."""
        (matrix, bias), *others = weights.encoder
        octants = _panels(octant_matrices(matrix))
        return cls(
            octants,
            bias,
            np.concatenate([_panels(matrix.T) for matrix, _ in others]),
            np.concatenate([np.pad(bias, (0, -len(bias) % WIDTH)) for _, bias in others]),
            np.array([0, -np.inf], np.float32),
            bool(octants[:, LUMINANCE::CHANNELS].any()),
        )


def _panels(matrix: np.ndarray) -> np.ndarray:
    """Panels (P, depth, WIDTH) of a matrix (depth, columns)."""
    filled = np.pad(matrix, ((0, 0), (0, -matrix.shape[1] % WIDTH)))
    return np.ascontiguousarray(filled.reshape(len(matrix), -1, WIDTH).transpose(1, 0, 2))


@device
def find_steps(bits, rows, steps):
    """Write the columns that are nonzero in any row into `steps` (depth + 1,); returns their number."""
    row0, row1, row2, row3 = bits[rows[0]], bits[rows[1]], bits[rows[2]], bits[rows[3]]
    used = np.empty(len(row0), np.int32)
    for column in range(len(row0)):
        used[column] = (row0[column] | row1[column] | row2[column] | row3[column]) & 0x7FFFFFFF  # without the sign
    count = 0
    for column in range(len(row0)):
        steps[count] = column
        count += 1 if used[column] != 0 else 0
    return count


@device
def sum_products(values, rows, steps, count, panels, panel, bias):
    """Sums of products of four rows with one panel, on top of the bias: left and right vector of each row."""
    depth = values.shape[1]
    row0, row1, row2, row3 = rows[0] * depth, rows[1] * depth, rows[2] * depth, rows[3] * depth
    left0 = left1 = left2 = left3 = load(bias, panel * WIDTH)
    right0 = right1 = right2 = right3 = load(bias, panel * WIDTH + LANES)
    for step in range(count):
        column = steps[step]
        offset = (panel * depth + column) * WIDTH
        left, right = load(panels, offset), load(panels, offset + LANES)
        left0, right0 = _add(left0, right0, spread(values, row0 + column), left, right)
        left1, right1 = _add(left1, right1, spread(values, row1 + column), left, right)
        left2, right2 = _add(left2, right2, spread(values, row2 + column), left, right)
        left3, right3 = _add(left3, right3, spread(values, row3 + column), left, right)
    return left0, right0, left1, right1, left2, right2, left3, right3


@device
def _add(left_sum, right_sum, value, left, right):
    return add_product(left_sum, value, left), add_product(right_sum, value, right)


@device
def write_sums(result, rows, panel, sums, least):
    """Write the sums of four rows, at least `least`, into a panel's columns of the result."""
    low = spread(least, 0)
    for row in range(ROWS):
        target = rows[row] * result.shape[1] + panel * WIDTH
        store(result, target, larger(low, sums[2 * row]))
        store(result, target + LANES, larger(low, sums[2 * row + 1]))
