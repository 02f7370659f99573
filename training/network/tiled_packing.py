# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrices of an encoder in bfloat16 as products in matrix units read them, kept up to date.

The optimiser packs each piece of the parameters that it has just moved, which still lies in a cache: to read them once
more for each part of a step took as long as a fifth of their products.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from torch import Tensor

from ...patchnet_addon.runtime.aligned_memory import aligned, aligned_bits
from ...patchnet_addon.runtime.kernels import device, kernel, lean_device
from ...patchnet_addon.runtime.vectors import LANES, load
from ..data.bfloat16 import store_bfloat, store_pairs
from .corner_layer import SLICES
from .flat_memory import MIDDLE, Sizes, flat_memory, middle_start
from .matrix_units import SIDE, transpose_words
from .tiled_products import TILE


class Packed(NamedTuple):
    """Packed matrices, bits of bfloat16: tiles (columns / 16, rows / 32) of 16 lines of 16 columns' pairs.

    Each word has the numbers of two rows. slices: (8 B width,), those of the first layer one after the other. forward:
    (2 width width,), matrices of the layers after it, transposed. back: the same, not transposed.
    """

    slices: np.ndarray
    forward: np.ndarray
    back: np.ndarray


class PackedMatrices:
    """Packed matrices of an encoder, whose parameters come first of some that lie in flat memory."""

    def __init__(self, parameters: Sequence[Tensor], sizes: Sizes) -> None:
        self._flat, self.sizes = flat_memory(parameters), sizes
        self._packed_from = parameters[0], parameters[2], parameters[4]
        square = MIDDLE * sizes.width**2
        self.arrays = Packed(*(aligned((n,), np.uint16) for n in (parameters[0].numel(), square, square)))
        self._versions: list[int] = []

    def current(self) -> Packed:
        """All of them; packed anew where torch has written into the parameters, as when a checkpoint is loaded."""
        versions = [matrix._version for matrix in self._packed_from]
        if versions != self._versions:
            _pack_all(self._flat.numpy(), self.sizes, self.arrays)
            self._versions = versions
        return self.arrays

    @property
    def step(self) -> int:
        """Numbers of 32 lines of a matrix, which are packed together."""
        return SIDE * self.sizes.width


@kernel
def _pack_all(flat, sizes, packed):  # type: ignore[no-untyped-def]
    pack_piece(flat, 0, len(flat), sizes, packed)


@device
def pack_piece(flat, first, last, sizes, packed):  # type: ignore[no-untyped-def]
    """Pack those of the parameters `first` to `last`, excluded, that are of packed matrices, by 32 lines each."""
    values, width = sizes.values, sizes.width
    lines = values * width
    for s in range(SLICES):
        begin, end = max(first, s * lines), min(last, (s + 1) * lines)
        if begin < end:
            top, bottom = (begin - s * lines) // width, (end - s * lines) // width
            pack_rows(flat, s * lines, (top, bottom), values, width, packed.slices.view(np.uint32), s * lines // 2)
    square = width * width
    for layer in range(MIDDLE):
        start = middle_start(layer, sizes)
        begin, end = max(first, start), min(last, start + square)
        if begin < end:
            rows, target = ((begin - start) // width, (end - start) // width), layer * square // 2
            pack_rows(flat, start, rows, width, width, packed.back.view(np.uint32), target)
            pack_columns(flat, start, rows, width, aligned_bits(TILE * width), packed.forward.view(np.uint32), target)


@lean_device
def pack_rows(matrix, start, rows, depth, columns, packed, to):  # type: ignore[no-untyped-def]
    """Pack some rows of a matrix (depth, columns), which begins at `start`, as a right factor: see `Packed`.

    rows: the first one and the one after the last, both even. packed: uint32.
    """
    for top in range(rows[0], rows[1], 2):  # as they lie in memory
        for column in range(0, columns, TILE):
            place, target = start + top * columns + column, to + (column * depth + top * TILE) // 2
            store_pairs(packed, target, load(matrix, place), load(matrix, place + columns))


@lean_device
def pack_columns(matrix, start, rows, depth, work, packed, to):  # type: ignore[no-untyped-def]
    """The same of a matrix whose columns are the rows of `matrix` (columns, depth), of which some are packed.

    rows: multiples of 16. work: (16 depth,) uint16.
    """
    words = work.view(np.uint32)
    for column in range(rows[0], rows[1], TILE):
        for k in range(0, TILE * depth, LANES):
            store_bfloat(work, k, load(matrix, start + column * depth + k))
        for k in range(0, depth // 2, TILE):
            transpose_words(words, k, depth // 2, packed, to + column * depth // 2 + k * TILE, TILE)
