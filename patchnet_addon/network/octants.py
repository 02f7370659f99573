# SPDX-License-Identifier: GPL-3.0-or-later
"""First layer of the encoder, octant by octant; only NumPy, as another Python that encodes may have nothing else."""

from __future__ import annotations

import numpy as np


def octant_matrices(matrix: np.ndarray) -> np.ndarray:
    """First layer's matrix (256, 8 B) as (B, 8 * 256): eight products of one block, octants x fastest.

    B: values of a voxel's block, 5 for each of its cells, whose number is a cube: 320 for a look-ahead of two levels.
    """
    outputs, size = matrix.shape
    side = round((size // 40) ** (1 / 3))
    parts = matrix.reshape(outputs, 2, side, 2, side, 2, side, 5)  # output; octant and cell of z, y, x; channel
    parts = parts.transpose(2, 4, 6, 7, 1, 3, 5, 0)  # cell z, y, x, channel; octant z, y, x; output
    return np.ascontiguousarray(parts.reshape(-1, 8 * outputs))
