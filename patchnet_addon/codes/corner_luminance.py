# SPDX-License-Identifier: GPL-3.0-or-later
"""Luminance around corners of voxels: the mean of the voxels, up to eight, that meet there (methods 11.1)."""

from __future__ import annotations

import numpy as np

from ..octree.octree import Octree
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .brick import covering_node
from .patches import corner_neighbours


def corner_luminance(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Luminance (C,) uint16, in the octree's units, around corners (C, 3) int32 of a level; 0 where nothing is."""
    result = np.empty(len(corners), np.uint16)
    run_parts(_write_all, len(corners), octree.nodes, octree.luminance, level, corners, result)
    return result


def corner_luminance_reference(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Reference of `corner_luminance` in NumPy, float64 (C,) and not rounded."""
    around = corner_neighbours(octree, level, corners)  # (C, 8)
    there = around >= 0
    luminance = np.where(there, octree.luminance[np.maximum(around, 0)].astype(np.float64), 0.0)
    result: np.ndarray = luminance.sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    return result


@kernel
def _write_all(first, last, nodes, luminance, level, corners, result):  # type: ignore[no-untyped-def]
    for corner in range(first, last):
        x, y, z = np.int64(corners[corner, 0]), np.int64(corners[corner, 1]), np.int64(corners[corner, 2])
        result[corner] = luminance_around(nodes, luminance, np.int64(0), level, x, y, z)


@device
def luminance_around(nodes, luminance, root, level, x, y, z):  # type: ignore[no-untyped-def]
    """Mean luminance, rounded, of the voxels of a level below `root` that meet at corner (x, y, z)."""
    total, count = np.int64(0), np.int64(0)
    for octant in range(8):
        column, line, plane = octant & 1, (octant >> 1) & 1, octant >> 2
        node = covering_node(nodes, root, level, x - 1 + column, y - 1 + line, z - 1 + plane)
        if node >= 0:
            total += np.int64(luminance[node])
            count += 1
    return (total + count // 2) // count if count > 0 else total
