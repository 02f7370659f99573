# SPDX-License-Identifier: GPL-3.0-or-later
"""Morton keys within kernels: `morton.py` compiled, one cell at a time."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device
from . import morton

_spread = device(morton.spread)
_gather = device(morton.gather)


@device
def cell_key(x, y, z):
    """Morton key (uint64) of one cell; compiled from `morton_encode`."""
    x_bits = _spread(np.uint64(x))
    return x_bits | (_spread(np.uint64(y)) << np.uint64(1)) | (_spread(np.uint64(z)) << np.uint64(2))


@device
def cell_coordinate(key, axis):
    """Coordinate (int64) along an axis of the cell of a key (uint64); compiled from `morton_decode`."""
    return np.int64(_gather(key >> np.uint64(axis)))
