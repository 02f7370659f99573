# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products of our own, for the encoder's layers: float32, with bias and ReLU, whatever BLAS NumPy has.

Sums of four rows times two vectors of columns stay in registers. The matrix is packed once into panels of as many
columns, which a core keeps in its nearest cache while it goes through a block of rows. Columns of the values that are
zero in all four rows are left out: most cells of a block are empty, and ReLU makes most of what a layer hands on zero.

A sum takes its terms in the order of columns. So a row has the same bits in whatever company, order and number of
threads it is computed; only a processor that cannot multiply and add in one rounding has others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..runtime.vectors import larger, store
from .simd import LANES, add_product, load, spread

WIDTH = 2 * LANES  # columns of a panel
ROWS = 4  # eight vectors of sums: with five or six rows the compiler runs out of registers, at half the speed
_TILES = 8  # in a block


@dataclass(frozen=True, eq=False)
class Panels:
    """Layer as `multiply` reads it.

    matrix: (P, depth, WIDTH) float32, panels of columns, the last one filled up with zeros. bias: (P * WIDTH,) float32.
    columns: of the matrix that was packed.
    """

    matrix: np.ndarray
    bias: np.ndarray
    columns: int

    @classmethod
    def pack(cls, matrix: np.ndarray, bias: np.ndarray | None = None) -> Panels:
        """Panels of a finite matrix (depth, columns) and a bias (columns,)."""
        depth, columns = matrix.shape
        count = -(-columns // WIDTH)
        filled = np.zeros((depth + 1, count * WIDTH), np.float32)
        filled[:depth, :columns] = matrix
        if bias is not None:
            filled[depth, :columns] = bias
        panels = filled[:depth].reshape(depth, count, WIDTH).transpose(1, 0, 2)
        return cls(np.ascontiguousarray(panels), filled[depth].copy(), columns)

    @property
    def width(self) -> int:
        """Columns of a result, filling included."""
        return len(self.bias)


def multiply(
    values: np.ndarray, panels: Panels, result: np.ndarray, *, relu: bool = False, order: np.ndarray | None = None
) -> None:
    """Write values (N, depth) times the packed matrix, plus its bias, into `result` (N, panels.width).

    All are float32 in C order. relu: negative results become 0. order: (N,) the rows, those that are zero in the same
    columns one after the other; it changes the time alone.
    """
    _check(values, (len(values), panels.matrix.shape[1]))
    _check(result, (len(values), panels.width))
    if order is None:
        order = np.arange(len(values))
    tiles = np.append(order, np.repeat(order[-1:], -len(order) % ROWS)).reshape(-1, ROWS)  # the last row fills the last
    least = np.array([0 if relu else -np.inf], np.float32)  # in memory, from where it is spread over a vector
    blocks = -(-len(tiles) // _TILES)
    rows = values, values.view(np.int32)
    run_parts(_multiply, blocks, rows, tiles, panels.matrix, panels.bias, least, result)


def _check(array: np.ndarray, shape: tuple[int, int]) -> None:
    """Raise ValueError for what the kernel, which checks no index, would misread."""
    if array.shape != shape or array.dtype != np.float32 or not array.flags.c_contiguous:
        raise ValueError(f"{array.dtype} of shape {array.shape} where float32 of shape {shape} in C order is needed")


@kernel
def _multiply(first, last, rows, tiles, panels, bias, least, result):
    """Multiply blocks of rows, which are given as values and as their bits."""
    values, bits = rows
    for block in range(first, last):
        here = tiles[block * _TILES : (block + 1) * _TILES]
        _multiply_block(values, bits, here, panels, bias, least, result)


@device
def _multiply_block(values, bits, tiles, panels, bias, least, result):
    """Multiply the rows `tiles` (t, 4) of the values; bits: the values as integers, which are compared faster."""
    steps = np.empty((_TILES, values.shape[1] + 1), np.int64)
    counts = np.empty(_TILES, np.int64)
    for tile in range(len(tiles)):
        counts[tile] = find_steps(bits, tiles[tile], steps[tile])
    for panel in range(len(panels)):
        for tile in range(len(tiles)):
            sums = sum_products(values, tiles[tile], steps[tile], counts[tile], panels, panel, bias)
            write_sums(result, tiles[tile], panel, sums, least)


@device
def find_steps(bits, rows, steps):
    """Write the columns that are not zero in all rows into `steps` (depth + 1,); returns how many they are."""
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
