# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes of leaves: extent of the surface in a voxel along each axis, in sixteenths (methods 4.1d).

A bar of half a voxel that spans two voxels marks both, and would be rendered four times as wide. So a ray meets a leaf
of the finest level only if it meets the box around its surface. A box contains its surface, so that surfaces have no
gaps. It is packed in three bytes, one per axis: the first sixteenth in the lower four bits, the last one in the upper
four.
"""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device

STEPS = 16
FILLED_STEPS = 3 * STEPS**2  # steps of the filled share of a voxel
WHOLE = 0xF0F0F0  # packed box of a whole voxel
_MARGIN = 1e-6  # tolerance for rounding of cuts, in sixteenths
_BITS = 8


def unpacked(packed: np.ndarray) -> np.ndarray:
    """Boxes (n, 3) uint8, a byte per axis, of packed ones (n,) uint32."""
    return np.ascontiguousarray(np.asarray(packed, "<u4").view(np.uint8).reshape(-1, 4)[:, :3])


def filled_steps(boxes: np.ndarray) -> np.ndarray:
    """Filled share of the voxels of boxes (n, 3) uint8, (n,) uint16 in steps of 1 / FILLED_STEPS.

    It is the mean of the covered shares along the three axes. Reference of `filled_share`.
    """
    x, y, z = (1 + (boxes >> 4).astype(np.uint16) - (boxes & 15)).T
    return np.asarray(x * y + y * z + z * x, np.uint16)


@device
def packed_axis(axis, low, high):
    """One axis of a packed box, from `low` to `high`, in voxel sides from the leaf's lowest corner."""
    first = min(max(np.floor(low * STEPS - _MARGIN), 0.0), STEPS - 1.0)
    last = min(max(np.ceil(high * STEPS + _MARGIN) - 1.0, first), STEPS - 1.0)
    return (np.uint64(first) | np.uint64(last) << np.uint64(4)) << np.uint64(_BITS * axis)


@device
def ends_of_axis(packed, axis):
    """Sum of the first and the last sixteenth of a packed box along an axis."""
    ends = np.int64(packed) >> (_BITS * axis)
    return (ends & 15) + (ends >> 4 & 15)


@device
def joined_boxes(one, other):
    """Packed bounding box of two packed ones."""
    joined = np.int64(0)
    for axis in range(3):
        a, b = (np.int64(one) >> (_BITS * axis)) & 255, (np.int64(other) >> (_BITS * axis)) & 255
        joined |= (min(a & 15, b & 15) | max(a >> 4, b >> 4) << 4) << (_BITS * axis)
    return joined


@device
def filled_share(boxes, row):
    """Mean of the shares of its voxel's faces that a box covers, float32."""
    x, y, z = box_side(boxes, row, 0), box_side(boxes, row, 1), box_side(boxes, row, 2)
    return np.float32(x * y + y * z + z * x) / np.float32(FILLED_STEPS)


@device
def covered_steps(boxes, row):
    """Covered part of the voxel's face along each axis, three numbers of 1 / STEPS^2 each."""
    x, y, z = box_side(boxes, row, 0), box_side(boxes, row, 1), box_side(boxes, row, 2)
    return y * z, x * z, x * y


@device
def box_side(boxes, row, axis):
    """Length of a box along an axis in sixteenths."""
    byte = np.int64(boxes[row, axis])
    return 1 + (byte >> 4) - (byte & 15)


@device
def mirrored_span(byte, mirrored):
    """First and last sixteenth of a box on an axis that may be mirrored."""
    first, last = np.int64(byte) & 15, np.int64(byte) >> 4
    return (15 - last, 15 - first) if mirrored else (first, last)
