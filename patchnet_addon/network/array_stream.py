# SPDX-License-Identifier: GPL-3.0-or-later
"""Array stream through a pipe: a line of JSON with type and shape, then the bytes; only NumPy, see `octants.py`."""

from __future__ import annotations

import json
import math
from typing import BinaryIO

import numpy as np


def write_array(stream: BinaryIO, array: np.ndarray) -> None:
    """Write an array of numbers; the caller flushes."""
    array = np.ascontiguousarray(array)
    stream.write((json.dumps([array.dtype.str, array.shape]) + "\n").encode())
    stream.write(array.reshape(-1).view(np.uint8).data)


def read_array(stream: BinaryIO) -> np.ndarray:
    """Read the next array; raises EOFError where the stream ends before it does, ValueError for anything else in it."""
    line = stream.readline()
    if not line:
        raise EOFError("the stream has ended")
    kind, shape = json.loads(line)
    dtype = np.dtype(kind)
    data = stream.read(math.prod(shape) * dtype.itemsize)
    if len(data) < math.prod(shape) * dtype.itemsize:
        raise EOFError("the stream ends within an array")
    return np.frombuffer(data, dtype).reshape(shape)
