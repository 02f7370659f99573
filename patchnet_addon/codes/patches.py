# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches of fine voxels (methods 7.7, 7.9): what PatchNet sees of the octree two levels ahead.

A voxel of level l holds a block of 4x4x4 cells of level l + 2. A corner (i, j, k) of level l sees the 8x8x8 cells
4 (i, j, k) + [-4, 4)^3, which are the blocks of the eight voxels around it. Blocks are ordered z, y, x, channel; the
channels are occupancy, luminance and the three components of the mean normal, all zero where there is nothing.

The kernels here run on one core: they alternate with matrix products, whose threads keep spinning for milliseconds
after each product, and waiting for a core costs ten times what a second core would save.
"""

from __future__ import annotations

import numpy as np

from ..octree.grid import morton_decode, morton_encode
from ..octree.octree import LUMINANCE_SCALE, NORMAL_SCALE, POPCOUNT, Octree
from ..runtime.kernels import device, serial_kernel

BLOCK_SIDE = 4  # 2^LOOK_AHEAD cells
CHANNELS = 5
BLOCK_SHAPE = (BLOCK_SIDE, BLOCK_SIDE, BLOCK_SIDE, CHANNELS)
BLOCK_SIZE = BLOCK_SIDE**3 * CHANNELS
# Offsets (8, 3) of a voxel's corners, x fastest; octant o of a corner is the voxel at corner - 1 + OCTANTS[o].
OCTANTS = np.array([(o & 1, o >> 1 & 1, o >> 2) for o in range(8)], np.int32)


def voxel_blocks(octree: Octree, nodes: np.ndarray) -> np.ndarray:
    """Blocks (N, 4, 4, 4, 5) float32 of the cells two levels below `nodes` (N,); node -1 has an empty block.

    A leaf above that level fills its part of the block as a solid block (methods 7.7); a node that is itself a leaf,
    the whole of it.
    """
    blocks = np.empty((len(nodes), *BLOCK_SHAPE), np.float32)
    _fill_blocks(
        octree.child_mask, octree.first_child, octree.luminance, octree.normal, np.asarray(nodes, np.int64), blocks
    )
    return blocks


def voxel_blocks_reference(octree: Octree, level: int, cells: np.ndarray) -> np.ndarray:
    """Blocks (N, 4, 4, 4, 5) of the voxels at `cells` (N, 3) of a level, by looking every fine cell up on its own."""
    axis = np.arange(BLOCK_SIDE)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    inner = np.stack([x, y, z], axis=-1).reshape(1, -1, 3)
    fine = BLOCK_SIDE * np.asarray(cells)[:, None, :] + inner  # (N, 64, 3)
    nodes = covering_nodes_reference(octree, level + 2, fine.reshape(-1, 3))
    values = np.zeros((len(nodes), CHANNELS), np.float32)
    there = nodes >= 0
    values[there, 0] = 1
    values[there, 1] = octree.luminance_float(nodes[there])
    values[there, 2:] = octree.normal_float(nodes[there])
    return values.reshape(-1, *BLOCK_SHAPE)


def covering_nodes(octree: Octree, level: int, cells: np.ndarray) -> np.ndarray:
    """Node (N,) int64 at each cell (N, 3) of a level, or the coarser leaf that covers it; -1 where it is empty."""
    cells = np.ascontiguousarray(cells, np.int32)
    nodes = np.empty(len(cells), np.int64)
    _find_covering(octree.child_mask, octree.first_child, level, cells, nodes)
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


def corner_table(octree: Octree, level: int, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def corner_blocks(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Patches (C, 8, 8, 8, 5) float32 of corners (C, 3) of a level, order z, y, x, channel (methods 7.9)."""
    neighbours = corner_neighbours(octree, level, corners)
    blocks = voxel_blocks(octree, neighbours.reshape(-1))
    eight = blocks.reshape(-1, 2, 2, 2, *BLOCK_SHAPE)  # (C, octant z, y, x, cell z, y, x, channel)
    return eight.transpose(0, 1, 4, 2, 5, 3, 6, 7).reshape(-1, *(2 * BLOCK_SIDE,) * 3, CHANNELS)


@device
def child_at(child_mask, first_child, node, octant):
    """Child of `node` in `octant`, -1 if there is none."""
    mask = np.int64(child_mask[node])
    if (mask >> octant) & 1 == 0:
        return np.int64(-1)
    return np.int64(first_child[node]) + np.int64(POPCOUNT[mask & ((1 << octant) - 1)])


@device
def covering_node(child_mask, first_child, level, x, y, z):
    """Node at cell (x, y, z) of a level, the coarser leaf that covers it, or -1; the cell may lie outside."""
    side = np.int64(1) << level
    if x < 0 or y < 0 or z < 0 or x >= side or y >= side or z >= side:
        return np.int64(-1)
    node = np.int64(0)
    for shift in range(level - 1, -1, -1):
        if child_mask[node] == 0:
            return node
        octant = ((x >> shift) & 1) | (((y >> shift) & 1) << 1) | (((z >> shift) & 1) << 2)
        node = child_at(child_mask, first_child, node, octant)
        if node < 0:
            return node
    return node


@serial_kernel
def _find_covering(child_mask, first_child, level, cells, nodes):
    for row in range(len(cells)):
        x, y, z = np.int64(cells[row, 0]), np.int64(cells[row, 1]), np.int64(cells[row, 2])
        nodes[row] = covering_node(child_mask, first_child, level, x, y, z)


@device
def _fill(block, x0, y0, z0, side, luminance, normal):
    """Give the cube of `side` cells at (x0, y0, z0) of a block the values of one node."""
    level_of_light = np.float32(luminance) / np.float32(LUMINANCE_SCALE)
    scale = np.float32(NORMAL_SCALE)
    for z in range(z0, z0 + side):
        for y in range(y0, y0 + side):
            for x in range(x0, x0 + side):
                block[z, y, x, 0] = np.float32(1)
                block[z, y, x, 1] = level_of_light
                for axis in range(3):
                    block[z, y, x, 2 + axis] = np.float32(normal[axis]) / scale


@serial_kernel
def _fill_blocks(child_mask, first_child, luminance, normal, nodes, blocks):
    for row in range(len(nodes)):
        block = blocks[row]
        block[:] = np.float32(0)
        node = nodes[row]
        if node < 0:
            continue
        if child_mask[node] == 0:
            _fill(block, 0, 0, 0, 4, luminance[node], normal[node])
            continue
        for outer in range(8):
            child = child_at(child_mask, first_child, node, outer)
            if child < 0:
                continue
            x, y, z = 2 * (outer & 1), outer & 2, (outer >> 2) * 2
            if child_mask[child] == 0:
                _fill(block, x, y, z, 2, luminance[child], normal[child])
                continue
            for inner in range(8):
                fine = child_at(child_mask, first_child, child, inner)
                if fine >= 0:
                    _fill(
                        block,
                        x + (inner & 1),
                        y + ((inner >> 1) & 1),
                        z + (inner >> 2),
                        1,
                        luminance[fine],
                        normal[fine],
                    )
