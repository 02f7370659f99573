# SPDX-License-Identifier: GPL-3.0-or-later
"""Morton keys: interleaved bits of a cell's coordinates, so that nearby cells have nearby keys.

A key of a level is that of its parent, times eight, plus the octant x + 2 y + 4 z. `spread` and `gather` work on arrays
and on single numbers: `morton_kernels.py` compiles them; this module does not need numba.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

POPCOUNT = np.array([value.bit_count() for value in range(256)], np.uint8)  # children of a node by its child mask
Bits = TypeVar("Bits", np.ndarray, np.uint64)


def morton_encode(cells: np.ndarray) -> np.ndarray:
    """Keys (...,) uint64 of integer cells (..., 3) of 0 to 2^21 - 1; x is the lowest bit of each triple."""
    x, y, z = (np.asarray(cells)[..., axis].astype(np.uint64) for axis in range(3))
    return spread(x) | (spread(y) << np.uint64(1)) | (spread(z) << np.uint64(2))


def morton_decode(keys: np.ndarray) -> np.ndarray:
    """Integer cells (..., 3) int32 of keys (...,); inverse of `morton_encode`."""
    keys = np.asarray(keys, np.uint64)
    axes = (gather(keys), gather(keys >> np.uint64(1)), gather(keys >> np.uint64(2)))
    return np.stack(axes, axis=-1).astype(np.int32)


def spread(bits: Bits) -> Bits:
    """Insert two zero bits between the lowest 21 bits of uint64."""
    bits = (bits | (bits << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
    bits = (bits | (bits << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | (bits << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | (bits << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (bits | (bits << np.uint64(2))) & np.uint64(0x1249249249249249)


def gather(bits: Bits) -> Bits:
    """Move bits 0, 3, 6, ... of uint64 together, and leave the others out; inverse of `spread`."""
    bits = bits & np.uint64(0x1249249249249249)
    bits = (bits ^ (bits >> np.uint64(2))) & np.uint64(0x10C30C30C30C30C3)
    bits = (bits ^ (bits >> np.uint64(4))) & np.uint64(0x100F00F00F00F00F)
    bits = (bits ^ (bits >> np.uint64(8))) & np.uint64(0x1F0000FF0000FF)
    bits = (bits ^ (bits >> np.uint64(16))) & np.uint64(0x1F00000000FFFF)
    return (bits ^ (bits >> np.uint64(32))) & np.uint64(0x1FFFFF)
