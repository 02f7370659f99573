# SPDX-License-Identifier: GPL-3.0-or-later
"""Bricks of 4x4x4 cells in a hash table, for sums per cell.

Neighbouring fragments share a brick, so that most lookups hit the cache, and only bricks are sorted at the end.
"""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device, kernel

BRICK_BITS = 6
BRICK_CELLS = 1 << BRICK_BITS


def table_of(brick_key: np.ndarray, bricks: int) -> np.ndarray:
    """Hash table (a power of two,) int32 for the bricks in `brick_key`; -1 where empty."""
    table = np.full(1 << (2 * len(brick_key) - 1).bit_length(), -1, np.int32)
    _insert_all(table, brick_key, bricks)
    return table


@device
def _slot(table, key):
    """First slot to probe for a brick: Fibonacci hashing."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((mixed >> np.uint64(32)) & np.uint64(len(table) - 1))


@kernel
def _insert_all(table: np.ndarray, brick_key: np.ndarray, bricks: int) -> None:
    for brick in range(bricks):
        slot = _slot(table, brick_key[brick])
        while table[slot] >= 0:
            slot = (slot + 1) & (len(table) - 1)
        table[slot] = brick


@device
def _find_brick(key, table, brick_key, count):
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
def brick_of(cell_key, last, table, brick_key, count):
    """Index of the brick of a cell, inserted if it is new; -1 without room. last: the previous result."""
    key = cell_key >> np.uint64(BRICK_BITS)
    if last >= 0 and brick_key[last] == key:
        return last
    return _find_brick(key, table, brick_key, count)
