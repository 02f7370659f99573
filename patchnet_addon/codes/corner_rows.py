# SPDX-License-Identifier: GPL-3.0-or-later
"""Corner codes as kernels read them: which rows of codes belong to a node's corners, and their mean at a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..network.lanes import HALF_SCALE, add_product, fill_16, load_halves, store, zeros_16
from ..network.weights import CODE_SIZE
from ..runtime.kernels import device
from .coded_octree import CodedOctree

MEAN_SIZE = 16  # of a mean that `write_mean_code` writes: two vectors of eight numbers, which overlap in the code
assert 8 <= CODE_SIZE <= 16

_SCALE = np.float32(HALF_SCALE)


class CornerCodes(NamedTuple):
    """Codes and what finds them.

    halves: (C * 10,) int16, the bits of the half floats. coded_index: (n,) int32. node_corners: (K, 8) uint32.
    """

    halves: np.ndarray
    coded_index: np.ndarray
    node_corners: np.ndarray

    @classmethod
    def of(cls, coded: CodedOctree) -> CornerCodes:
        """Codes of an octree."""
        return cls(coded.codes.view(np.int16).ravel(), coded.coded_index, coded.node_corners)


@device
def coded_row(coded_index, node):
    """Row of a node among those with codes; -1 for nodes without look-ahead, and for a miss (-1)."""
    return np.int64(coded_index[node]) if node >= 0 else np.int64(-1)


@device
def corner_row(node_corners, row, octant):
    """Row in the codes of a corner of a node with codes; octants x fastest."""
    return np.int64(node_corners[row, octant])


@device
def write_mean_code(halves, node_corners, row, point, mean):
    """Write the trilinear mean of a node's eight codes at a point in it, three numbers in [0, 1], into `mean` (16,).

    The code's first eight numbers come first, its last eight follow.
    """
    one = np.float32(1)
    x, y, z = point
    total = zeros_16()
    for octant in range(8):
        share = x if octant & 1 else one - x
        share *= y if octant & 2 else one - y
        share *= z if octant & 4 else one - z
        first = corner_row(node_corners, row, octant) * CODE_SIZE
        total = add_product(total, load_halves(halves, first, first + CODE_SIZE - 8), fill_16(share * _SCALE))
    store(mean, 0, total)
