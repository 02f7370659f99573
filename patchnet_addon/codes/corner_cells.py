# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells around corners of voxels: luminance, in a byte, of the eight of the next finer level that meet there.

Of a voxel's eight corners these are the 4x4x4 cells in it and around it to half its side. A byte is 0 for an empty
cell, else 1 + 254 sqrt(luminance), rounded: an error of at most 0.004 where it is bright (methods 11.2).
"""

from __future__ import annotations

import numpy as np

from ..network.kinds import CORNERS
from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .brick import covering_node
from .patches import OCTANTS, covering_nodes_reference

EMPTY = 0
_STEPS = 254


def cell_luminance_table() -> np.ndarray:
    """Luminance (256,) float32 in [0, 1] that a byte stands for, -1 for an empty cell."""
    table = np.maximum(np.arange(256) - 1, 0).astype(np.float32) / np.float32(_STEPS)
    table *= table
    table[EMPTY] = -1
    return table


def corner_cells(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Bytes (C, 8) uint8 of the cells, x fastest, that meet at corners (C, 3) int32 of a level."""
    result = np.empty((len(corners), CORNERS), np.uint8)
    run_parts(_write_all, len(corners), octree.nodes, octree.luminance, level, corners, result)
    return result


def corner_cells_reference(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Reference of `corner_cells` in NumPy."""
    cells = (2 * np.asarray(corners)[:, None] - 1 + OCTANTS).reshape(-1, 3)
    node = covering_nodes_reference(octree, level + 1, cells)
    root = np.sqrt(octree.luminance[np.maximum(node, 0)] / LUMINANCE_SCALE)
    found = np.where(node >= 0, 1 + np.floor(_STEPS * root + 0.5), EMPTY)
    return found.astype(np.uint8).reshape(-1, CORNERS)


@kernel
def _write_all(first, last, nodes, luminance, level, corners, result):  # type: ignore[no-untyped-def]
    for corner in range(first, last):
        x, y, z = 2 * np.int64(corners[corner, 0]), 2 * np.int64(corners[corner, 1]), 2 * np.int64(corners[corner, 2])
        for octant in range(CORNERS):
            column, line, plane = octant & 1, (octant >> 1) & 1, octant >> 2
            node = covering_node(nodes, np.int64(0), level + 1, x - 1 + column, y - 1 + line, z - 1 + plane)
            result[corner, octant] = _byte_of(luminance, node)


@device
def _byte_of(luminance, node):  # type: ignore[no-untyped-def]
    if node < 0:
        return np.uint8(EMPTY)
    return np.uint8(1 + np.int64(np.floor(_STEPS * np.sqrt(luminance[node] / LUMINANCE_SCALE) + 0.5)))


@device
def write_cells_around(nodes, luminance, root, voxel, cells):  # type: ignore[no-untyped-def]
    """Write the bytes (64,) of the cells around the corners of a voxel (level, x, y, z) of the octree at `root`."""
    for corner in range(CORNERS):
        x, y, z = 2 * (corner & 1), 2 * ((corner >> 1) & 1), 2 * (corner >> 2)
        x, y, z = 2 * voxel[1] + x - 1, 2 * voxel[2] + y - 1, 2 * voxel[3] + z - 1
        for octant in range(CORNERS):
            column, line, plane = octant & 1, (octant >> 1) & 1, octant >> 2
            node = covering_node(nodes, root, voxel[0] + 1, x + column, y + line, z + plane)
            cells[CORNERS * corner + octant] = _byte_of(luminance, node)
