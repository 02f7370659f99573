# SPDX-License-Identifier: GPL-3.0-or-later
"""Occupied leaf cells, one bit each, without light and areas: for fitting leaf levels to cameras."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..runtime.kernels import kernel
from ..surface.mesh import Fragments
from .accumulate import MIN_OPACITY
from .bricks import BRICK_BITS, BRICK_CELLS, brick_of, table_of

_FIRST_BRICKS = 1 << 10


class OccupiedCells:
    """Cells with opaque fragments; `take` returns them in the order of keys.

    The cells are those of `LeafAccumulator`'s leaves, in 12 bytes for each brick of 64 and its hash table.
    """

    def __init__(self) -> None:
        self._keys = np.zeros(_FIRST_BRICKS, np.uint64)
        self._cells = np.zeros(_FIRST_BRICKS, np.uint64)  # a bit for each cell of a brick
        self._used = np.zeros(1, np.int64)
        self._table = table_of(self._keys, 0)

    def __len__(self) -> int:
        """Number of bricks."""
        return int(self._used[0])

    def add(
        self, fragments: Fragments, _luminance: np.ndarray, opacity: np.ndarray, *_: np.ndarray, facing: Any = None
    ) -> None:
        """Add the cells of fragments with an opacity (F,) of at least 1/255; arguments as of `LeafAccumulator.add`."""
        opacity = np.asarray(opacity, np.float32)
        first = 0
        while first < len(fragments):
            first = _mark(first, fragments.keys, opacity, self._table, self._keys, self._used, self._cells)
            if first < len(fragments):
                more = len(self) + len(self) // 2
                self._keys.resize(more, refcheck=False)
                self._cells.resize(more, refcheck=False)
                self._table = table_of(self._keys, len(self))

    def take(self) -> np.ndarray:
        """Keys (n,) uint64 of the cells, ascending."""
        bricks = len(self)
        order = np.argsort(self._keys[:bricks])
        keys = np.empty(_count(self._cells[:bricks]), np.uint64)
        _list(order, self._keys, self._cells, keys)
        return keys


@kernel
def _mark(first, keys, opacity, table, brick_keys, used, cells):  # type: ignore[no-untyped-def]
    """Mark the cells of fragments from `first` on; returns the first without room, or their number."""
    brick = np.int64(-1)
    for i in range(first, len(keys)):
        if not opacity[i] >= MIN_OPACITY:
            continue
        brick = brick_of(keys[i], brick, table, brick_keys, used)
        if brick < 0:
            return i
        cells[brick] |= np.uint64(1) << (keys[i] & np.uint64(BRICK_CELLS - 1))
    return len(keys)


@kernel
def _count(cells):  # type: ignore[no-untyped-def]
    """Number of set bits."""
    count = 0
    for bits in cells:
        while bits:
            bits &= bits - np.uint64(1)
            count += 1
    return count


@kernel
def _list(order, brick_keys, cells, keys):  # type: ignore[no-untyped-def]
    """Write the keys of the cells of all bricks, in Morton order."""
    at = 0
    for brick in order:
        for cell in range(BRICK_CELLS):
            if (cells[brick] >> np.uint64(cell)) & np.uint64(1):
                keys[at] = (brick_keys[brick] << np.uint64(BRICK_BITS)) | np.uint64(cell)
                at += 1
