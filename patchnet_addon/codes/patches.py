# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches of fine voxels (methods 7.7, 7.9): what PatchNet sees of the octree some levels ahead.

With a look-ahead of n levels, a voxel of level l holds a block of s^3 cells of level l + n, s = 2^n. A corner (i, j, k)
of level l sees the (2 s)^3 cells s (i, j, k) + [-s, s)^3, which are the blocks of the eight voxels around it; for two
levels, blocks are 4x4x4 and patches 8x8x8. Blocks are ordered z, y, x, channel; the channels are occupancy, luminance
and the three components of the mean normal, all zero where there is nothing. Occupancy is 1, or what the box of a leaf
fills of it (methods 4.1d).

The kernels here run on one core: they alternate with matrix products, whose threads keep spinning for milliseconds
after each product, and waiting for a core costs ten times what a second core would save.
"""

from __future__ import annotations

import numpy as np

from ..cells.morton import morton_decode, morton_encode
from ..network.weights import CHANNELS
from ..octree.leaf_boxes import FILLED_STEPS, filled_share
from ..octree.octree import LUMINANCE_SCALE, NORMAL_SCALE, Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import kernel
from .brick import check_nodes, covering_node, fill_block

# Offsets (8, 3) of a voxel's corners, x fastest; octant o of a corner is the voxel at corner - 1 + OCTANTS[o].
OCTANTS = np.array([(o & 1, o >> 1 & 1, o >> 2) for o in range(8)], np.int32)


def voxel_blocks(octree: Octree, nodes: np.ndarray, lookahead: int = DEFAULT_LOOKAHEAD) -> np.ndarray:
    """Blocks (N, s, s, s, 5) float32 of the cells `lookahead` levels below `nodes` (N,); node -1 has an empty block.

    A leaf above that level fills its part of the block as a solid block (methods 7.7); a node that is itself a leaf,
    the whole of it. Raises SettingError for an octree of more than 2^31 nodes.
    """
    check_nodes(octree.node_count)
    side = 1 << lookahead
    blocks = np.zeros((len(nodes), side**3, CHANNELS), np.float32)
    voxels = np.asarray(nodes, np.int64)
    _fill_blocks(octree.boxed_nodes, octree.luminance, octree.normal, voxels, lookahead, blocks)
    return blocks.reshape(-1, side, side, side, CHANNELS)


def voxel_blocks_reference(
    octree: Octree, level: int, cells: np.ndarray, lookahead: int = DEFAULT_LOOKAHEAD
) -> np.ndarray:
    """Blocks (N, s, s, s, 5) of the voxels at `cells` (N, 3) of a level, by looking every fine cell up on its own."""
    side = 1 << lookahead
    axis = np.arange(side)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    inner = np.stack([x, y, z], axis=-1).reshape(1, -1, 3)
    fine = side * np.asarray(cells)[:, None, :] + inner  # (N, s^3, 3)
    nodes = covering_nodes_reference(octree, level + lookahead, fine.reshape(-1, 3))
    values = np.zeros((len(nodes), CHANNELS), np.float32)
    there = nodes >= 0
    values[there, 0] = octree.filled[nodes[there]] / np.float32(FILLED_STEPS)
    values[there, 1] = octree.luminance_float(nodes[there])
    values[there, 2:] = octree.normal_float(nodes[there])
    return values.reshape(-1, side, side, side, CHANNELS)


def covering_nodes(octree: Octree, level: int, cells: np.ndarray) -> np.ndarray:
    """Node (N,) int64 at each cell (N, 3) of a level, or the coarser leaf that covers it; -1 where it is empty."""
    cells = np.ascontiguousarray(cells, np.int32)
    nodes = np.empty(len(cells), np.int64)
    _find_covering(octree.nodes, level, cells, nodes)
    return nodes


def covering_nodes_reference(octree: Octree, level: int, cells: np.ndarray) -> np.ndarray:
    """Reference of `covering_nodes` by one search of the sorted keys per level, from the finest up."""
    nodes = np.full(len(cells), -1, np.int64)
    for coarser in range(min(level, octree.depth), -1, -1):
        found = octree.find(coarser, np.asarray(cells) >> (level - coarser))
        leaf = (found >= 0) & (octree.child_mask[found] == 0)
        accepted = (nodes < 0) & (leaf | ((found >= 0) & (coarser == level)))
        nodes[accepted] = found[accepted]
    return nodes


def corner_table_reference(octree: Octree, level: int, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct corners (C, 3) int32 of `nodes` (K,) of a level, in Morton order, and rows (K, 8) uint32 in that list.

    The rows are those of each node's corners, in the order of `OCTANTS`.
    """
    cells = morton_decode(octree.keys(level)[np.asarray(nodes) - octree.level_start[level]])
    keys = np.unique(np.concatenate([morton_encode(cells + offset) for offset in OCTANTS]))
    rows = np.empty((len(cells), 8), np.uint32)
    for octant, offset in enumerate(OCTANTS):
        rows[:, octant] = np.searchsorted(keys, morton_encode(cells + offset))
    return morton_decode(keys), rows


def corner_neighbours(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Nodes (C, 8) int64 of the eight voxels around each corner (C, 3) of a level, in the order of `OCTANTS`.

    A coarser leaf where it covers the voxel, -1 where the voxel is empty or outside the cube.
    """
    cells = np.asarray(corners)[:, None, :] - 1 + OCTANTS  # (C, 8, 3)
    return covering_nodes(octree, level, cells.reshape(-1, 3)).reshape(-1, 8)


def corner_blocks_reference(
    octree: Octree, level: int, corners: np.ndarray, lookahead: int = DEFAULT_LOOKAHEAD
) -> np.ndarray:
    """Patches (C, 2 s, 2 s, 2 s, 5) float32 of corners (C, 3) of a level, order z, y, x, channel (methods 7.9)."""
    side = 1 << lookahead
    neighbours = corner_neighbours(octree, level, corners)
    blocks = voxel_blocks(octree, neighbours.reshape(-1), lookahead)
    eight = blocks.reshape(-1, 2, 2, 2, *blocks.shape[1:])  # (C, octant z, y, x, cell z, y, x, channel)
    return eight.transpose(0, 1, 4, 2, 5, 3, 6, 7).reshape(-1, *(2 * side,) * 3, CHANNELS)


@kernel
def _find_covering(nodes, level, cells, found):
    for row in range(len(cells)):
        x, y, z = np.int64(cells[row, 0]), np.int64(cells[row, 1]), np.int64(cells[row, 2])
        found[row] = covering_node(nodes, 0, level, x, y, z)


@kernel
def _fill_blocks(nodes, luminance, normal, voxels, lookahead, blocks):
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
            blocks[row, cell, 0] = filled_share(nodes.boxes, boxed) if boxed >= 0 else np.float32(1)
            blocks[row, cell, 1] = np.float32(luminance[node]) / luminance_scale
            for axis in range(3):
                blocks[row, cell, 2 + axis] = np.float32(normal[node, axis]) / normal_scale
