# SPDX-License-Identifier: GPL-3.0-or-later
"""Index of codes for kernels."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device
from .corner_rows import HIGH, LOW, MAX_STEP, STEPS


@device
def corner_row(table, row, octant):
    """Row in the codes of one corner, x + 2 y + 4 z, of a coded voxel."""
    start = np.int64(table[row, HIGH if octant & 4 else LOW])
    if octant & 2:
        start += (np.int64(table[row, STEPS]) >> (4 * (octant & 4))) & MAX_STEP
    return start + (octant & 1)
