# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes of leaves for kernels: a box around a piece of surface, and the part of the voxel that it fills."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import device
from .leaf_boxes import BITS, FILLED_STEPS, STEPS

_MARGIN = 1e-6  # tolerance for rounding of cuts, in sixteenths


@device
def packed_axis(axis, low, high):
    """One axis of a packed box, from `low` to `high`, in voxel sides from the leaf's lowest corner."""
    first = min(max(np.floor(low * STEPS - _MARGIN), 0.0), STEPS - 1.0)
    last = min(max(np.ceil(high * STEPS + _MARGIN) - 1.0, first), STEPS - 1.0)
    return (np.uint64(first) | np.uint64(last) << np.uint64(4)) << np.uint64(BITS * axis)


@device
def ends_of_axis(packed, axis):
    """Sum of the first and the last sixteenth of a packed box along an axis."""
    ends = np.int64(packed) >> (BITS * axis)
    return (ends & 15) + (ends >> 4 & 15)


@device
def joined_boxes(one, other):
    """Packed bounding box of two packed ones."""
    joined = np.int64(0)
    for axis in range(3):
        a, b = (np.int64(one) >> (BITS * axis)) & 255, (np.int64(other) >> (BITS * axis)) & 255
        joined |= (min(a & 15, b & 15) | max(a >> 4, b >> 4) << 4) << (BITS * axis)
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
