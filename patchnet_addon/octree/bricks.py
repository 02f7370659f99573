# SPDX-License-Identifier: GPL-3.0-or-later
"""Bricks of 4x4x4 cells, for sums per cell.

Neighbouring fragments share a brick, so that most lookups hit the cache, and only bricks are sorted at the end.
"""

from __future__ import annotations

import numpy as np

from ..cells.hashing import entered_row
from ..runtime.kernels import device

BRICK_BITS = 6
BRICK_CELLS = 1 << BRICK_BITS


@device
def brick_of(cell_key, last, slots, brick_keys, count):
    """Index of the brick of a cell, entered if it is new; -1 without room. last: the previous result."""
    key = cell_key >> np.uint64(BRICK_BITS)
    if last >= 0 and brick_keys[last] == key:
        return last
    return entered_row(slots, brick_keys, count, key)
