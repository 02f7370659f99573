# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of cells in bits of bfloat16 where a cell is four numbers, occupancy and normal: one word of 64 bits.

A normal has 255 values along an axis, whose bits stand in a table, and a symmetry turns no more than their signs.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.octree.leaf_boxes import filled_share
from ...patchnet_addon.octree.octree import NORMAL_SCALE
from ...patchnet_addon.runtime.bits import lowest_one
from ...patchnet_addon.runtime.kernels import lean_device
from ...patchnet_addon.runtime.vectors import OCTANTS, words_from_zero
from .bfloat16 import narrow_bits

TOGETHER = 64  # cells whose occupancy is told at once
_SIGN = 0x8000
_WHOLE = 0x3F80  # bits of 1


def _normal_bits() -> np.ndarray:
    """Bits (256,) int64 of a component of a normal, by its int8 as uint8."""
    values = np.arange(256, dtype=np.uint8).view(np.int8) * np.float32(1.0 / NORMAL_SCALE)
    return np.array([narrow_bits.py_func(value) for value in values], np.int64)  # type: ignore[attr-defined]


_NORMAL_BITS = _normal_bits()


@lean_device
def occupied_cells(nodes, first, count):  # type: ignore[no-untyped-def]
    """Cells that hold a node, of at most TOGETHER from a flat index of a brick's `nodes` on, as bits of an integer."""
    found = np.int64(0)
    for cell in range(0, min(count, TOGETHER), OCTANTS):
        found |= words_from_zero(nodes, first + cell) << cell
    return found


@lean_device
def write_words(own, normal, brick, block, turned, words):  # type: ignore[no-untyped-def]
    """Write the cells of a block into `words` (8^n,) int64.

    own: `BoxedNodes`. turned: axes and signs of a symmetry, and where it moves cells.
    """
    axis, sign, to_cell = turned
    nodes, first_boxed, boxes = brick.nodes, own.first_boxed, own.boxes
    ax, ay, az = axis[0], axis[1], axis[2]
    signs = np.int64(0)
    for k in range(3):
        signs |= np.int64(_SIGN if sign[k] < 0 else 0) << (16 * (k + 1))
    words[:] = 0
    cells = len(words)
    for first in range(0, cells, TOGETHER):
        left = occupied_cells(nodes, block * cells + first, cells - first)
        while left != 0:
            cell = first + lowest_one(left)
            left &= left - 1
            node = np.int64(nodes[block, cell])
            share = np.int64(_WHOLE)
            if node >= first_boxed:
                share = np.int64(narrow_bits(filled_share(boxes, node - first_boxed)))
            x, y = _NORMAL_BITS[np.uint8(normal[node, ax])], _NORMAL_BITS[np.uint8(normal[node, ay])]
            z = _NORMAL_BITS[np.uint8(normal[node, az])]
            words[to_cell[cell]] = share | (x << 16 | y << 32 | z << 48) ^ signs
