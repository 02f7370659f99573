# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes of leaves: extent of the surface in a voxel along each axis, in sixteenths (methods 4.1d).

A bar of half a voxel that spans two voxels marks both, and would be rendered four times as wide. So a ray meets a leaf
of the finest level only if it meets the box around its surface. A box contains its surface, so that surfaces have no
gaps. It is packed in three bytes, one per axis: the first sixteenth in the lower four bits, the last one in the upper
four. `leaf_box_kernels.py` has functions for kernels.
"""

from __future__ import annotations

import numpy as np

STEPS = 16
FILLED_STEPS = 3 * STEPS**2  # steps of the filled share of a voxel
WHOLE = 0xF0F0F0  # packed box of a whole voxel
BITS = 8  # of an axis


def unpacked(packed: np.ndarray) -> np.ndarray:
    """Boxes (n, 3) uint8, a byte per axis, of packed ones (n,) uint32."""
    return np.ascontiguousarray(np.asarray(packed, "<u4").view(np.uint8).reshape(-1, 4)[:, :3])


def filled_steps(boxes: np.ndarray) -> np.ndarray:
    """Filled share of the voxels of boxes (n, 3) uint8, (n,) uint16 in steps of 1 / FILLED_STEPS.

    It is the mean of the covered shares along the three axes. Reference of `filled_share`.
    """
    x, y, z = (1 + (boxes >> 4).astype(np.uint16) - (boxes & 15)).T
    return np.asarray(x * y + y * z + z * x, np.uint16)
