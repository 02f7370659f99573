# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet's encoder without torch, for many corners that share the blocks of the voxels between them.

A corner's patch is eight blocks of 4x4x4 cells and the first layer is linear. So every voxel's block is multiplied once
with the eight slices of the first matrix, and each corner adds up the eight products that belong to it: exact, with
about half the operations and without copying eight blocks per corner.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..kernels import serial_kernel
from .octants import octant_matrices
from .weights import Weights


class Encoder(Protocol):
    """What encodes the corners of a chunk; `chunk` is the number of corners that it likes at once."""

    chunk: int

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32 of corners whose eight octants hold `blocks[rows]`.

        blocks: (U, 320) float32, z, y, x, channel; block 0 is empty. rows: (C, 8) integers, octants x fastest.
        """


class NumpyEncoder:
    """Encoder on BLAS and a compiled sum. It keeps its buffers, because fresh pages cost as much as the sums."""

    chunk = 4096

    def __init__(self, weights: Weights) -> None:
        matrix, self._bias = weights.encoder[0]
        self._octants = octant_matrices(matrix)
        self._layers = [(np.ascontiguousarray(matrix.T), bias) for matrix, bias in weights.encoder[1:]]
        self._buffers: dict[str, np.ndarray] = {}

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """See `Encoder`."""
        products = self._buffer("products", len(blocks), self._octants.shape[1])  # (U, 8 * 256)
        np.matmul(blocks, self._octants, out=products)
        values = self._buffer("layer 0", len(rows), len(self._bias))
        _sum_octants(products, np.asarray(rows, np.int64), self._bias, values)
        for index, (matrix, bias) in enumerate(self._layers, 1):
            result = self._buffer(f"layer {index}", len(rows), len(bias))
            np.matmul(values, matrix, out=result)
            result += bias
            if index < len(self._layers):
                np.maximum(result, 0, out=result)
            values = result
        return values.copy()

    def _buffer(self, name: str, rows: int, columns: int) -> np.ndarray:
        if name not in self._buffers or len(self._buffers[name]) < rows:
            self._buffers[name] = np.empty((rows, columns), np.float32)
        return self._buffers[name][:rows]


@serial_kernel
def _sum_octants(products, rows, bias, values):
    """First layer with ReLU: values[c] = max(0, bias + sum over octants o of products[rows[c, o], slice o]).

    On one core, as `codes/patches.py` explains.
    """
    width = len(bias)
    for corner in range(len(rows)):
        total = values[corner]
        for k in range(width):
            total[k] = bias[k]
        for octant in range(8):
            row = rows[corner, octant]
            if row > 0:  # block 0 is empty
                part = products[row, octant * width : (octant + 1) * width]
                for k in range(width):
                    total[k] += part[k]
        for k in range(width):
            total[k] = max(total[k], np.float32(0))
