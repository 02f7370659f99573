# SPDX-License-Identifier: GPL-3.0-or-later
"""Bricks of 4x4x4 cells in a hash table, for sums per cell, and for cells that are only marked as occupied.

Neighbouring fragments share a brick, so that most lookups hit the cache, and only bricks are sorted at the end.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..runtime.kernels import device, kernel
from ..runtime.vectors import count_ones
from ..surface.mesh import Fragments

BRICK_BITS = 6
BRICK_CELLS = 1 << BRICK_BITS
MIN_OPACITY = 1.0 / 255.0
_FIRST_BRICKS = 1 << 10


def table_of(brick_key: np.ndarray, bricks: int) -> np.ndarray:
    """Hash table (a power of two,) int32 for the bricks in `brick_key`; -1 where empty."""
    table = np.full(1 << (2 * len(brick_key) - 1).bit_length(), -1, np.int32)
    _insert_all(table, brick_key, bricks)
    return table


@device
def _slot(table, key):  # type: ignore[no-untyped-def]
    """First slot to probe for a brick: Fibonacci hashing."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((mixed >> np.uint64(32)) & np.uint64(len(table) - 1))


@kernel
def _insert_all(table, brick_key, bricks):  # type: ignore[no-untyped-def]
    for brick in range(bricks):
        slot = _slot(table, brick_key[brick])
        while table[slot] >= 0:
            slot = (slot + 1) & (len(table) - 1)
        table[slot] = brick


@device
def _find_brick(key, table, brick_key, count):  # type: ignore[no-untyped-def]
    """Index of a brick, inserted if it is new; -1 without room."""
    slot = _slot(table, key)
    while table[slot] >= 0:
        if brick_key[table[slot]] == key:
            return np.int64(table[slot])
        slot = (slot + 1) & (len(table) - 1)
    brick = count[0]
    if brick == len(brick_key):
        return np.int64(-1)
    table[slot] = brick
    brick_key[brick] = key
    count[0] += 1
    return brick


@device
def brick_of(cell_key, last, table, brick_key, count):  # type: ignore[no-untyped-def]
    """Index of the brick of a cell, inserted if it is new; -1 without room. last: the previous result."""
    key = cell_key >> np.uint64(BRICK_BITS)
    if last >= 0 and brick_key[last] == key:
        return last
    return _find_brick(key, table, brick_key, count)


class OccupiedCells:
    """Cells with opaque fragments, for fitting leaf levels to cameras; `take` returns them in the order of keys.

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
        count += count_ones(bits)
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
