# SPDX-License-Identifier: GPL-3.0-or-later
"""Index of codes: coded nodes, and rows of the codes of their eight corners, in 12 bytes instead of 32.

Codes of a level are stored plane by plane, line by line, x fastest. So the corner at x + 1 is the row after the one at
x, and four rows determine all eight: those of the corners (x, y, z), (x, y + 1, z), (x, y, z + 1), (x, y + 1, z + 1).
The first two, and the last two, are less than a line of corners apart, which fits 16 bits.

A table (K, 3) uint32 has a line for each coded voxel, in node order: the rows of (x, y, z) and (x, y, z + 1), and the
offsets to those of y + 1, the first in the low half of the third number. Which nodes have codes is one bit per node of
levels that may have look-ahead, whose nodes come first, and one count per 64: a fifth of a byte per node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..directional.node_light import marked
from ..octree.octree import Octree
from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.errors import SettingError

LOW, HIGH, STEPS = range(3)  # columns: rows of (x, y, z) and (x, y, z + 1), and the offsets
COLUMNS = 3
MAX_STEP = 0xFFFF  # from y to y + 1


class CodedNodes(NamedTuple):
    """Coded nodes of an octree.

    bits: (W,) uint64, bit n % 64 of word n // 64 set if node n is coded; nodes beyond the words are not coded. ranks:
    (W,) uint32, coded nodes before each word. `row_of` finds the row of a node.
    """

    bits: np.ndarray
    ranks: np.ndarray


def coded_nodes(octree: Octree, lookahead: int) -> tuple[CodedNodes, int]:
    """Nodes with real descendants `lookahead` levels further down (methods 4.1b), and their number.

    Raises SettingError for too many nodes.
    """
    end = int(octree.level_start[max(octree.depth - lookahead + 1, 0)])
    check_count(end, UINT32_COUNT, "nodes of levels with look-ahead", NODE_ADVICE)
    ahead = np.flatnonzero(octree.look_ahead(lookahead))
    return CodedNodes(*marked(ahead, end)), len(ahead)


def last_row(table: np.ndarray) -> int:
    """Last row in the codes referenced by a table (K, 3), -1 for none."""
    steps = np.stack([table[:, STEPS] & MAX_STEP, table[:, STEPS] >> 16], axis=1)
    return int((table[:, :STEPS] + steps.astype(np.int64)).max(initial=-2)) + 1


def set_corner_rows(table: np.ndarray, lines: np.ndarray, octant: int, starts: np.ndarray) -> None:
    """Write rows (V,) of the corners (0, y, z), octant 2 y + 4 z, into lines (V,); y = 0 first, since y = 1 is stored
    as an offset.

    Raises SettingError if offsets exceed 16 bits.
    """
    column = HIGH if octant & 4 else LOW
    if octant & 2 == 0:
        table[lines, column] = starts
        return
    steps = starts - table[lines, column].astype(np.int64)
    table[lines, STEPS] |= (steps << (16 if octant & 4 else 0)).astype(np.uint32)
    if steps.max(initial=0) > MAX_STEP:
        raise SettingError("A line of voxels has more corners than the codes' table can hold: choose a smaller depth")
