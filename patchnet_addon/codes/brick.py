# SPDX-License-Identifier: GPL-3.0-or-later
"""Brick of 12x12x12 fine cells around a voxel, as 27 blocks of 4x4x4 (methods 7.7, 7.9).

A brick is an array (27, 64) int32 of the nodes that fill its cells, -1 where a cell is empty. Blocks and the cells in
them run in the order z, y, x. Outside of the root cube everything is empty; a leaf coarser than the fine level fills
all its cells.
"""

from __future__ import annotations

import numpy as np

from ..octree.octree import LOOK_AHEAD, Octree
from ..runtime.kernels import device
from .patches import BLOCK_SIDE, child_at

EMPTY = -1


@device
def find_node(child_mask, first_child, root, level, x, y, z):
    """Node below `root` that holds a cell of a level, and its own level: a lower one if a coarser leaf covers it.

    The node is -1 where the cell is empty or outside of the root.
    """
    side = 1 << level
    if x < 0 or y < 0 or z < 0 or x >= side or y >= side or z >= side:
        return -1, level
    node = np.int64(root)
    for depth in range(level):
        if child_mask[node] == 0:
            return node, depth
        shift = level - 1 - depth
        octant = ((x >> shift) & 1) | (((y >> shift) & 1) << 1) | (((z >> shift) & 1) << 2)
        node = child_at(child_mask, first_child, node, octant)
        if node < 0:
            return -1, level
    return node, level


@device
def fill_block(child_mask, first_child, node, is_leaf_above, cells):
    """Write the 64 fine cells of a voxel into `cells` (64,) and return how many are occupied."""
    if is_leaf_above or child_mask[node] == 0:
        cells[:] = node
        return 64
    cells[:] = -1
    count = 0
    child = np.int64(first_child[node])
    for octant in range(8):
        if (child_mask[node] >> octant) & 1 == 0:
            continue
        corner = (octant & 1) * 2 + ((octant >> 1) & 1) * 8 + (octant >> 2) * 32
        fine_mask = child_mask[child]
        fine = np.int64(first_child[child])
        for suboctant in range(8):
            cell = corner + (suboctant & 1) + ((suboctant >> 1) & 1) * 4 + (suboctant >> 2) * 16
            if fine_mask == 0:
                cells[cell] = child
                count += 1
            elif (fine_mask >> suboctant) & 1:
                cells[cell] = fine
                fine += 1
                count += 1
        child += 1
    return count


@device
def fill_brick(child_mask, first_child, root, level, x, y, z, brick, counts):
    """Write the brick of the voxel (x, y, z) of a level into `brick` (27, 64), and its blocks' `counts` (27,).

    `brick` holds nodes only in blocks whose count is not 0; the others keep what they had.
    """
    for block in range(27):
        nx, ny, nz = x + block % 3 - 1, y + block // 3 % 3 - 1, z + block // 9 - 1
        node, found = find_node(child_mask, first_child, root, level, nx, ny, nz)
        if node < 0:
            counts[block] = 0
        else:
            counts[block] = fill_block(child_mask, first_child, node, found < level, brick[block])


def brick_nodes(octree: Octree, level: int, cell: np.ndarray) -> np.ndarray:
    """Plain twin of `fill_brick`: nodes (12, 12, 12) int64 in the order z, y, x, -1 for empty, by look-ups of keys."""
    low = (np.asarray(cell, np.int64) - 1) * BLOCK_SIDE
    axis = np.arange(3 * BLOCK_SIDE)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    fine = np.stack([x, y, z], axis=-1).reshape(-1, 3) + low  # (1728, 3)
    nodes = np.full(len(fine), EMPTY, np.int64)
    for up in range(level + LOOK_AHEAD + 1):  # from the finest level to the root: only leaves count above the finest
        here = octree.find(level + LOOK_AHEAD - up, fine >> up) if level + LOOK_AHEAD - up <= octree.depth else None
        if here is None:
            continue
        valid = here >= 0
        if up > 0:
            valid &= octree.child_mask[np.maximum(here, 0)] == 0
        nodes = np.where((nodes < 0) & valid, here, nodes)
    return nodes.reshape(3 * BLOCK_SIDE, 3 * BLOCK_SIDE, 3 * BLOCK_SIDE)
