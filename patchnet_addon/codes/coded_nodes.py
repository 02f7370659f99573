# SPDX-License-Identifier: GPL-3.0-or-later
"""Coded nodes: which nodes of an octree have codes, and how many stand before each."""

from __future__ import annotations

import numpy as np

from ..octree.octree import Octree
from ..runtime.bits import count_ones
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts


def coded_nodes(octree: Octree, lookahead: int) -> tuple[np.ndarray, int]:
    """Rows (n,) int32 of nodes among the coded ones, -1 for the others, and the number of coded nodes.

    Those are coded that have real descendants `lookahead` levels further down (methods 4.1b): of the n nodes of levels
    that may have look-ahead, which stand before all others.
    """
    marks = np.empty(int(octree.level_start[max(octree.depth - lookahead + 1, 0)]), np.bool_)
    run_parts(_mark, len(marks), octree.nodes, lookahead, marks)
    rows = np.where(marks, np.cumsum(marks, dtype=np.int32) - np.int32(1), np.int32(-1))
    return rows, int(np.count_nonzero(marks))


@device
def coded_row(rows, node):  # type: ignore[no-untyped-def]
    """Row of a node among the coded ones, -1 if it is not one, or is -1."""
    return np.int64(rows[node]) if 0 <= node < len(rows) else np.int64(-1)


@kernel
def _mark(first, last, nodes, lookahead, coded):  # type: ignore[no-untyped-def]
    for node in range(first, last):
        coded[node] = _has_descendants(nodes, node, lookahead)


@device
def _has_descendants(nodes, node, levels):  # type: ignore[no-untyped-def]
    """Return whether a node has descendants so many levels, 1 to 3, further down."""
    count = count_ones(np.uint64(nodes.child_mask[node]))
    if count == 0 or levels == 1:
        return count > 0
    first = np.int64(nodes.first_child[node])
    for child in range(first, first + count):
        children = count_ones(np.uint64(nodes.child_mask[child]))
        if levels == 2 and children > 0:
            return True
        first_grandchild = np.int64(nodes.first_child[child])
        for grandchild in range(first_grandchild, first_grandchild + children):
            if nodes.child_mask[grandchild] != 0:
                return True
    return False
