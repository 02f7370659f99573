# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches of fine voxels (methods 7.7, 7.9): PatchNet's input, the octree some levels ahead.

With a look-ahead of n levels, a voxel of level l holds a block of s^3 cells of level l + n, s = 2^n. A corner (i, j, k)
of level l has the (2 s)^3 cells s (i, j, k) + [-s, s)^3, which are the blocks of the eight voxels around it; for two
levels, blocks are 4x4x4 and patches 8x8x8. Blocks are ordered z, y, x, channel; the channels are occupancy, luminance
and the three components of the mean normal, all zero in empty cells. Occupancy is 1, or the share that the box of a
leaf fills (methods 4.1d).

The kernels here run on one core: they alternate with matrix products, whose threads keep spinning for milliseconds
after each product. Waiting for a core costs ten times what a second core saves.
"""

from __future__ import annotations

import numpy as np

from ..network.weights import CHANNELS
from ..octree.leaf_boxes import filled_share
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
