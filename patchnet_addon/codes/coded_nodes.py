# SPDX-License-Identifier: GPL-3.0-or-later
"""Coded nodes: which nodes of an octree have codes, and how many stand before each; a bit a node and a count for 512.

Only levels that may have look-ahead have bits, which all stand before the others: a quarter byte a coded voxel or so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..octree.octree import Octree
from ..runtime.bits import count_ones
from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts

_GROUP = 8  # words from count to count


class CodedNodes(NamedTuple):
    """Coded nodes of an octree.

    bits: (W,) uint64, bit n % 64 of word n // 64 set if node n is coded; nodes beyond the words are not.
    before: (ceil(W / 8),) uint32, coded nodes before each eighth word.
    total: coded nodes of all.
    """

    bits: np.ndarray
    before: np.ndarray
    total: int

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.bits.nbytes + self.before.nbytes


def coded_nodes(octree: Octree, lookahead: int) -> CodedNodes:
    """Nodes with real descendants `lookahead` levels further down (methods 4.1b); raises SettingError for too many."""
    end = int(octree.level_start[max(octree.depth - lookahead + 1, 0)])
    check_count(end, UINT32_COUNT, "nodes of levels with look-ahead", NODE_ADVICE)
    bits = np.zeros(-(-end // 64), np.uint64)
    before = np.zeros(-(-len(bits) // _GROUP), np.uint32)
    run_parts(_mark, len(before), octree.nodes, lookahead, end, bits, before)
    sums = np.cumsum(before, dtype=np.int64)
    before[1:] = sums[:-1]
    before[:1] = 0
    return CodedNodes(bits, before, int(sums[-1]) if len(sums) else 0)


def coded_rows(coded: CodedNodes, nodes: np.ndarray) -> np.ndarray:
    """Row (...,) int64 of each node (...,) among the coded ones, -1 for those that are not; node -1 is none."""
    wanted = np.asarray(nodes, np.int64)
    rows = np.empty(wanted.size, np.int64)
    run_parts(_find_rows, len(rows), coded.bits, coded.before, np.ascontiguousarray(wanted.reshape(-1)), rows)
    return rows.reshape(wanted.shape)


@device
def is_coded(bits, node):  # type: ignore[no-untyped-def]
    """Return whether a node, 0 or more, has codes."""
    word = node >> 6
    return word < len(bits) and (bits[word] >> np.uint64(node & 63)) & np.uint64(1) != 0


@device
def coded_row(bits, before, node):  # type: ignore[no-untyped-def]
    """Row of a node among the coded ones, -1 if it is not one, or is -1."""
    if node < 0 or not is_coded(bits, node):
        return np.int64(-1)
    word = node >> 6
    group = word >> 3
    row = np.int64(before[group])
    for other in range(group << 3, word):
        row += count_ones(bits[other])
    return row + count_ones(bits[word] & ((np.uint64(1) << np.uint64(node & 63)) - np.uint64(1)))


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


@kernel
def _mark(first, last, nodes, lookahead, end, bits, groups):  # type: ignore[no-untyped-def]
    """Write the bits of nodes 0 to `end`, and the number of them in each group of words."""
    for group in range(first, last):
        count = 0
        for word in range(group * _GROUP, min((group + 1) * _GROUP, len(bits))):
            found = np.uint64(0)
            for node in range(64 * word, min(64 * (word + 1), end)):
                if _has_descendants(nodes, node, lookahead):
                    found |= np.uint64(1) << np.uint64(node & 63)
            bits[word] = found
            count += count_ones(found)
        groups[group] = count


@kernel
def _find_rows(first, last, bits, before, nodes, rows):  # type: ignore[no-untyped-def]
    for index in range(first, last):
        rows[index] = coded_row(bits, before, nodes[index])
