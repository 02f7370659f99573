# SPDX-License-Identifier: GPL-3.0-or-later
"""Corner codes as kernels read them: the codes of a node's corners, and their mean at a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..network.kinds import CODE_SIZE
from ..network.simd import HALF_SCALE, add_product, load_halves
from ..runtime.kernels import device
from ..runtime.vectors import splat, store
from .coded_octree import CodedOctree
from .corner_rows import corner_row

MEAN_SIZE = 16  # of a mean that `write_mean_code` writes: two vectors of eight numbers, which overlap in the code
assert 8 <= CODE_SIZE <= 16

_SCALE = np.float32(HALF_SCALE)


class CornerCodes(NamedTuple):
    """Codes and what finds them.

    halves: (C * 10,) int16, the bits of the half floats. bits, before: of `CodedNodes`. rows: (K, 3) uint32, as
    `corner_rows.py` says.
    """

    halves: np.ndarray
    bits: np.ndarray
    before: np.ndarray
    rows: np.ndarray

    @classmethod
    def of(cls, coded: CodedOctree) -> CornerCodes:
        """Codes of an octree."""
        return cls(coded.codes.view(np.int16).ravel(), coded.nodes.bits, coded.nodes.before, coded.corner_rows)


@device
def write_mean_code(halves, table, row, point, mean):  # type: ignore[no-untyped-def]
    """Write the trilinear mean of a node's eight codes at a point in it, three numbers in [0, 1], into `mean` (16,).

    The code's first eight numbers come first, its last eight follow.
    """
    one = np.float32(1)
    x, y, z = point
    total = splat(np.float32(0))
    for line in range(4):
        share = y if line & 1 else one - y
        share *= z if line & 2 else one - z
        first = corner_row(table, row, 2 * line) * CODE_SIZE
        left, right = splat(share * (one - x) * _SCALE), splat(share * x * _SCALE)
        total = add_product(total, load_halves(halves, first, first + CODE_SIZE - 8), left)
        first += CODE_SIZE  # the corner at x + 1 has the next row
        total = add_product(total, load_halves(halves, first, first + CODE_SIZE - 8), right)
    store(mean, 0, total)
