# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes of 64 bits, and tables that find a key's row: open addressing, in arrays of kernels."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device, kernel


@device
def mixed(h, value):
    """Hash (uint64) of a hash, or another integer, and a further integer, by the finalizer of SplitMix64.

    The product keeps pairs of small integers apart, such as levels and faces, of which others have the same XOR.
    """
    h = (np.uint64(h) * np.uint64(0x9E3779B97F4A7C15)) ^ np.uint64(value)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return h ^ (h >> np.uint64(31))


def slots_for(count: int) -> np.ndarray:
    """Empty slots (a power of two,) int32 for `count` keys, twice as many at least."""
    return np.zeros(1 << max(2 * count, 2).bit_length(), np.int32)


@device
def row_of_key(slots, keys, key):
    """Row of a key in `keys` (n,) uint64, or -1 - slot of the free slot where it belongs."""
    slot = np.int64((key * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(32)) & np.uint64(len(slots) - 1))
    while slots[slot] > 0:
        row = slots[slot] - 1
        if keys[row] == key:
            return row
        slot = (slot + 1) & (len(slots) - 1)
    return -1 - slot


@device
def entered_row(slots, keys, used, key):
    """Row (int64) of a key, entered behind the `used` (1,) rows of `keys` if it is new; -1 if these have no room."""
    row = np.int64(row_of_key(slots, keys, key))
    if row >= 0:
        return row
    slot, row = -1 - row, np.int64(used[0])
    if row == len(keys):
        return np.int64(-1)
    slots[slot] = row + 1
    keys[row] = key
    used[0] += 1
    return row


@kernel
def fill_slots(slots: np.ndarray, keys: np.ndarray, rows: np.ndarray) -> None:
    """Enter some rows (m,) of different keys (n,); slots hold rows + 1, and 0 where they are free."""
    for row in rows:
        slots[-1 - row_of_key(slots, keys, keys[row])] = row + 1
