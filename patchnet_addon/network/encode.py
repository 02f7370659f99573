# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's encoder without torch, for many corners that share the blocks of the voxels between them.

A corner's patch is eight blocks, of 4x4x4 cells each for a look-ahead of two levels, and the first layer is linear. So
every voxel's block is multiplied once with the eight slices of the first matrix, and each corner adds up the eight
products that belong to it: exact, with about half the operations and without copying eight blocks per corner.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..runtime.vectors import larger, store
from .octants import octant_matrices
from .simd import LANES, load, zeros
from .weights import Weights


class Encoder(Protocol):
    """Encoder of the corners of a chunk; `chunk` is the number of corners that it likes at once."""

    chunk: int

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32 of corners whose eight octants hold `blocks[rows]`.

        blocks: (U, B) float32, z, y, x, channel, B = 320 for two levels; block 0 is empty. rows: (C, 8) integers,
        octants x fastest.
        """


class Buffers:
    """Arrays that are kept from chunk to chunk, because fresh pages cost as much as sums."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def __call__(self, name: str, rows: int, columns: int) -> np.ndarray:
        """Array (rows, columns) float32 of that name; what it holds is left from before."""
        if name not in self._arrays or len(self._arrays[name]) < rows:
            self._arrays[name] = np.empty((rows, columns), np.float32)
        return self._arrays[name][:rows]


class NumpyEncoder:
    """`Encoder` on NumPy's products, as fast as its BLAS: the Reference of `CompiledEncoder`."""

    chunk = 4096

    def __init__(self, weights: Weights) -> None:
        matrix, self._bias = weights.encoder[0]
        self._octants = octant_matrices(matrix)
        self._layers = [(np.ascontiguousarray(matrix.T), bias) for matrix, bias in weights.encoder[1:]]
        self._buffers = Buffers()

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Encode as `Encoder` says."""
        products = self._buffers("products", len(blocks), self._octants.shape[1])  # (U, 8 * 256)
        np.matmul(blocks, self._octants, out=products)
        values = self._buffers("layer 0", len(rows), len(self._bias))
        run_parts(sum_octants, len(rows), products, np.asarray(rows, np.int64), self._bias, values)
        for index, (matrix, bias) in enumerate(self._layers, 1):
            result = self._buffers(f"layer {index}", len(rows), len(bias))
            np.matmul(values, matrix, out=result)
            result += bias
            if index < len(self._layers):
                np.maximum(result, 0, out=result)
            values = result
        return values.copy()


@kernel
def sum_octants(first, last, products, rows, bias, values):
    """First layer of corners with ReLU, as `codes/patches.py` explains."""
    for corner in range(first, last):
        sum_corner(products, rows[corner], bias, values, corner)


@device
def sum_corner(products, eight, bias, values, corner):
    """First layer of one corner: values[c] = max(0, bias + sum over octants o of products[eight[o], slice o])."""
    width = len(bias)
    for column in range(0, width, LANES):
        total = load(bias, column)
        for octant in range(8):
            if eight[octant] > 0:  # block 0 is empty
                total = total + load(products, (8 * eight[octant] + octant) * width + column)
        store(values, corner * width + column, larger(zeros(), total))
