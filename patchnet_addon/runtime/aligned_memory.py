# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory that begins at a multiple of 64 bytes, a line of the cache: NumPy's begins anywhere at a multiple of 16.

Vectors of 512 bits and lines of matrix units that lie in two lines of the cache take several times as long to read.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .kernels import device

LINE = 64  # bytes


def aligned(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Array whose numbers are anything."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.empty(size + LINE, np.uint8)
    before = -memory.ctypes.data % LINE
    return memory[before : before + size].view(dtype).reshape(shape)


@device
def aligned_bits(count):
    """So many uint16, in kernels; what they hold is anything."""
    memory = np.empty(count + LINE // 2, np.uint16)
    before = (LINE - memory.ctypes.data % LINE) % LINE // 2
    return memory[before : before + count]


@device
def aligned_floats(count):
    """The same for float32."""
    return aligned_bits(2 * count).view(np.float32)


@device
def aligned_zeros(rows, columns):
    """Array (rows, columns) of float32 zeros, in kernels."""
    values = aligned_floats(rows * columns)
    values[:] = 0
    return values.reshape(rows, columns)
