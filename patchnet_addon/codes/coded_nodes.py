# SPDX-License-Identifier: GPL-3.0-or-later
"""Coded nodes: which nodes of an octree have codes, and the number before each; one bit per node and one count per 64.

Only levels that may have look-ahead have bits; their nodes come first. The cost is a fifth of a byte per node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.contract import has_lookahead
from ..octree.octree import Octree
from ..runtime.bits import count_ones
from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.kernels import kernel
from ..runtime.threads import run_parts


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
    bits, counts = np.zeros(-(-end // 64), np.uint64), np.zeros(-(-end // 64), np.uint32)
    run_parts(_mark, len(bits), octree.nodes, lookahead, end, bits, counts)
    total = int(counts.sum(dtype=np.int64))
    return CodedNodes(bits, np.cumsum(counts, dtype=np.uint32) - counts), total


@kernel
def _mark(first, last, nodes, lookahead, end, bits, counts):  # type: ignore[no-untyped-def]
    for word in range(first, last):
        found = np.uint64(0)
        for node in range(64 * word, min(64 * (word + 1), end)):
            if has_lookahead(nodes.child_mask, nodes.first_child, node, lookahead):
                found |= np.uint64(1) << np.uint64(node & 63)
        bits[word] = found
        counts[word] = count_ones(found)
