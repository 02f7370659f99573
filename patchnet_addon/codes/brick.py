# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of fine cells in a voxel, PatchNet's input, and bricks, 27 blocks around a voxel (methods 7.7, 7.9).

With a look-ahead of n levels, a block is a cube of 2^n cells a side: 4x4x4 for two levels, and a brick 12x12x12. A
brick is an array (27, 8^n) int32 of the nodes that fill its cells, -1 for an empty cell. Blocks and their cells are in
the order z, y, x. Outside of the root cube everything is empty; a leaf coarser than the fine level fills all its cells.
The patch of a corner is the eight blocks around it, 8x8x8 cells for two levels. As input of an encoder a cell has five
channels: occupancy, luminance and the three components of the mean normal, all zero in empty cells. Occupancy is 1, or
the share that the box of a leaf fills (methods 4.1d).

Kernels for whole octrees run on one core: they alternate with matrix products, whose threads keep spinning for
milliseconds after each product. Waiting for a core costs ten times what a second core saves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.leaf_box_kernels import filled_share
from ..cells.morton import POPCOUNT
from ..cells.scales import LUMINANCE_SCALE, NORMAL_SCALE
from ..network.encoders import CHANNELS, LUMINANCE, NORMAL, OCCUPANCY
from ..network.kinds import CHILDREN
from ..octree.octree import Nodes, Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD, INT32_COUNT, NODE_ADVICE, check_count
from ..runtime.kernels import array_device, device, kernel

EMPTY = -1
MIDDLE = 13  # the block that is the voxel itself
# Offsets (8, 3) of a voxel's corners, x fastest; octant o of a corner is the voxel at corner - 1 + OCTANTS[o].
OCTANTS = np.array([(o & 1, o >> 1 & 1, o >> 2) for o in range(8)], np.int32)


def _ranks() -> np.ndarray:
    """Number of children before each of the eight, (256, 8) int32 by child mask; for missing children so negative that
    the sum with any node stays negative. A leaf, of mask 0, represents each of its parts.
    """
    there = np.arange(256)[:, None] >> np.arange(CHILDREN) & 1 == 1
    ranks = np.where(there, np.cumsum(there, axis=1) - 1, np.iinfo(np.int32).min)
    ranks[0] = 0
    return ranks.astype(np.int32)


RANKS = _ranks()
_PARTS = (RANKS >= 0).sum(axis=1).astype(np.uint8)


class Brick(NamedTuple):
    """Fine cells around a voxel.

    nodes: (27, 8^n) int32, valid only in blocks whose count is not 0; others keep stale values.
    counts: (27,) int32, occupied cells of each block.
    around: (27,) int32, each block's voxel node, or the coarser leaf that covers it, EMPTY for none.
    """

    nodes: np.ndarray
    counts: np.ndarray
    around: np.ndarray


def check_nodes(count: int) -> None:
    """Raise SettingError for more nodes than the 32-bit cells of bricks and blocks can index."""
    check_count(count, INT32_COUNT, "nodes", NODE_ADVICE)


@device
def child_at(nodes, node, octant):
    """Child of `node` in `octant`, -1 if there is none."""
    mask = np.int64(nodes.child_mask[node])
    if (mask >> octant) & 1 == 0:
        return np.int64(-1)
    return np.int64(nodes.first_child[node]) + np.int64(POPCOUNT[mask & ((1 << octant) - 1)])


@device
def covering_node(nodes, root, level, x, y, z):
    """Node below `root` at cell (x, y, z) of a level, the coarser leaf that covers it, or -1; the cell may lie
    outside."""
    side = np.int64(1) << level
    if x < 0 or y < 0 or z < 0 or x >= side or y >= side or z >= side:
        return np.int64(-1)
    node = np.int64(root)
    for shift in range(level - 1, -1, -1):
        if nodes.child_mask[node] == 0:
            return node
        octant = ((x >> shift) & 1) | (((y >> shift) & 1) << 1) | (((z >> shift) & 1) << 2)
        node = child_at(nodes, node, octant)
        if node < 0:
            return node
    return node


@device
def fill_block(nodes, node, lookahead, cells):
    """Write the nodes of a voxel's fine cells into `cells` (8^lookahead,) and return the number of occupied ones.

    Top-down, level by level: a node is stored in the first cell that it fills until it is divided.
    """
    masks, first_children = nodes.child_mask, nodes.first_child
    side = 1 << lookahead
    cells[:] = EMPTY
    cells[0] = node
    width, count = side, 0
    while width > 1:
        count = 0
        for z in range(0, side, width):
            for y in range(0, side, width):
                for x in range(0, side, width):
                    corner = x + side * (y + side * z)
                    here = np.int64(cells[corner])
                    if here >= 0:
                        count += _write_parts(masks, first_children, here, side, width >> 1, corner, cells)
        width >>= 1
    return count


@device
def _write_parts(masks, first_children, node, side, half, corner, cells):
    """Write the children of a node into its eight parts, `half` cells wide, from a corner on; returns their number.

    A leaf fills all parts. All parts are written, which avoids unpredictable branches.
    """
    mask = np.int64(masks[node])
    first = node if mask == 0 else np.int64(first_children[node])
    for z in range(2):
        for y in range(2):
            for x in range(2):
                part = first + RANKS[mask, x + 2 * y + 4 * z]
                cells[corner + half * (x + side * (y + side * z))] = max(part, EMPTY)
    return np.int64(_PARTS[mask])


@device
def nodes_around(nodes, root, level, cell, around):
    """Write the nodes of the 27 voxels around `cell` (x, y, z) of a level below `root`, as in `Brick.around`."""
    x, y, z = np.int64(cell[0]) - 1, np.int64(cell[1]) - 1, np.int64(cell[2]) - 1
    for block in range(27):
        around[block] = covering_node(nodes, root, level, x + block % 3, y + block // 3 % 3, z + block // 9)


@array_device
def empty_brick(lookahead):
    """Allocate a brick."""
    return Brick(np.empty((27, 1 << 3 * lookahead), np.int32), np.empty(27, np.int32), np.empty(27, np.int32))


@device
def fill_brick(nodes, root, level, cell, lookahead, brick):
    """Write the brick of the voxel at `cell` (x, y, z) of a level below `root` into `brick`, a `Brick`."""
    nodes_around(nodes, root, level, cell, brick.around)
    fill_blocks(nodes, lookahead, brick)


@device
def fill_blocks(nodes, lookahead, brick):
    """Write the cells of a brick whose `around` is set, and the number of occupied ones per block."""
    cells, counts, around = brick.nodes, brick.counts, brick.around
    for block in range(27):
        node = np.int64(around[block])
        counts[block] = 0 if node < 0 else fill_block(nodes, node, lookahead, cells[block])


def voxel_blocks(octree: Octree, nodes: np.ndarray, lookahead: int = DEFAULT_LOOKAHEAD) -> np.ndarray:
    """Blocks (N, s, s, s, 5) float32 of the cells `lookahead` levels below `nodes` (N,); node -1 has an empty block.

    A leaf above that level fills its part of the block as a solid block (methods 7.7); a node that is itself a leaf,
    the whole of it. Raises SettingError for an octree of more than 2^31 nodes.
    """
    check_nodes(octree.node_count)
    side = 1 << lookahead
    blocks = np.zeros((len(nodes), side**3, CHANNELS), np.float32)
    voxels = np.asarray(nodes, np.int64)
    _fill_blocks(octree.nodes, octree.luminance, octree.normal, voxels, lookahead, blocks)
    return blocks.reshape(-1, side, side, side, CHANNELS)


def covering_nodes(octree: Octree, level: int, cells: np.ndarray) -> np.ndarray:
    """Node (N,) int64 at each cell (N, 3) of a level, or the coarser leaf that covers it; -1 for an empty cell."""
    cells = np.ascontiguousarray(cells, np.int32)
    nodes = np.empty(len(cells), np.int64)
    _find_covering(octree.nodes, level, cells, nodes)
    return nodes


def corner_neighbours(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Nodes (C, 8) int64 of the eight voxels around each corner (C, 3) of a level, in the order of `OCTANTS`.

    A coarser leaf if it covers the voxel, -1 for a voxel that is empty or outside the cube.
    """
    cells = np.asarray(corners)[:, None, :] - 1 + OCTANTS  # (C, 8, 3)
    return covering_nodes(octree, level, cells.reshape(-1, 3)).reshape(-1, 8)


@kernel
def _find_covering(nodes: Nodes, level: int, cells: np.ndarray, found: np.ndarray) -> None:
    for row in range(len(cells)):
        x, y, z = np.int64(cells[row, 0]), np.int64(cells[row, 1]), np.int64(cells[row, 2])
        found[row] = covering_node(nodes, 0, level, x, y, z)


@kernel
def _fill_blocks(
    nodes: Nodes, luminance: np.ndarray, normal: np.ndarray, voxels: np.ndarray, lookahead: int, blocks: np.ndarray
) -> None:
    """Write the blocks of nodes `voxels` (N,) into `blocks` (N, 8^lookahead, 5), all zero."""
    cells = np.empty(blocks.shape[1], np.int32)
    luminance_scale, normal_scale = np.float32(LUMINANCE_SCALE), np.float32(NORMAL_SCALE)
    for row in range(len(voxels)):
        if voxels[row] < 0:
            continue
        fill_block(nodes, voxels[row], lookahead, cells)
        for cell in range(len(cells)):
            node = cells[cell]
            if node < 0:
                continue
            boxed = np.int64(node) - nodes.first_boxed
            blocks[row, cell, OCCUPANCY] = filled_share(nodes.boxes, boxed) if boxed >= 0 else np.float32(1)
            blocks[row, cell, LUMINANCE] = np.float32(luminance[node]) / luminance_scale
            for axis in range(3):
                blocks[row, cell, NORMAL + axis] = np.float32(normal[node, axis]) / normal_scale
