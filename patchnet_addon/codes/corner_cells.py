# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells around corners of voxels: shape and luminance of the eight cells of the next finer level, 32 bits each.

For a voxel's eight corners these are the 4x4x4 cells in it and up to half its side around it. A word is 0 for an empty
cell. Else its bits 0 to 7 are the cell's children (all eight for a leaf), and the rest the luminances of its six faces:
a face's luminance is the mean over its four columns of the child that a ray hits first. Bits 8 to 15 are the mean b of
the faces' roots, of 255; five bits from 16, 21 and 26 on, for each axis, 15 + 15 t, where the face hit by a ray up the
axis is (b - t|t| / 2)^2 and the opposite one (b + t|t| / 2)^2 (methods 11.2).
"""

from __future__ import annotations

import numpy as np

from ..cells.scales import LUMINANCE_SCALE
from ..directional.node_kernels import row_of, side_root
from ..directional.node_light import NodeLight
from ..network.kinds import CORNERS
from ..octree.octree import Nodes, Octree
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from .brick import RANKS, covering_node

EMPTY = 0
BASE, BASE_STEPS = 8, 255  # first bit, and steps, of the mean root
SLOPE, SLOPE_BITS, SLOPE_STEPS = 16, 5, 15  # of the difference along an axis, in both directions
FACES = 6  # two along each axis, first the one hit by a ray up the axis

_STEP = np.float32(1.0 / LUMINANCE_SCALE)
_COLUMNS = [[octant for octant in range(8) if not octant >> axis & 1] for axis in range(3)]  # lower child of each


def corner_cells(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Words (C, 8) uint32 of the cells, x fastest, around corners (C, 3) int32 of a level."""
    result = np.empty((len(corners), CORNERS), np.uint32)
    run_parts(_write_all, len(corners), octree.nodes, octree.light, level, corners, result)
    return result


@kernel
def _write_all(
    first: int, last: int, nodes: Nodes, light: NodeLight, level: int, corners: np.ndarray, result: np.ndarray
) -> None:
    for corner in range(first, last):
        here = corners[corner]
        x, y, z = 2 * np.int64(here[0]), 2 * np.int64(here[1]), 2 * np.int64(here[2])
        for octant in range(CORNERS):
            column, line, plane = octant & 1, octant >> 1 & 1, octant >> 2
            node = covering_node(nodes, np.int64(0), level + 1, x - 1 + column, y - 1 + line, z - 1 + plane)
            result[corner, octant] = word_of(nodes, light, node)


@device
def word_of(nodes, light, node):
    """Word of the cell that a node fills, -1 for none."""
    if node < 0:
        return np.uint32(EMPTY)
    mask, row = np.int64(nodes.child_mask[node]), row_of(light.sides, node)
    if row >= 0:
        total, slopes = _of_sides(light, node, row)
    else:
        total, slopes = _of_children(light.luminance, mask, np.int64(nodes.first_child[node]) if mask else node)
    base = np.int32(np.float32(BASE_STEPS) * (total / np.float32(FACES)) + np.float32(0.5))
    return np.uint32(np.int32(mask if mask else 255) | base << np.int32(BASE) | slopes)


@device
def _of_sides(light, node, row):
    """Sum of roots and slopes of a cell's own sides, where a surface faces them."""
    mean = np.sqrt(np.float32(light.luminance[node]) / np.float32(LUMINANCE_SCALE))
    total, slopes = np.float32(0), np.int32(0)
    for axis in range(3):
        low, high = side_root(light.sides, row, 2 * axis + 1, mean), side_root(light.sides, row, 2 * axis, mean)
        total += low + high
        slopes |= _slope_of(low, high) << np.int32(SLOPE + SLOPE_BITS * axis)
    return total, slopes


@device
def _of_children(luminance, mask, first):
    """Sum of roots and slopes of the faces of a cell by its children, the first of them at `first`; a leaf is its own.

    Written out: loops with skips take three times as long.
    """
    a, b = _child_light(luminance, mask, first, 0), _child_light(luminance, mask, first, 1)
    c, d = _child_light(luminance, mask, first, 2), _child_light(luminance, mask, first, 3)
    e, f = _child_light(luminance, mask, first, 4), _child_light(luminance, mask, first, 5)
    g, h = _child_light(luminance, mask, first, 6), _child_light(luminance, mask, first, 7)
    left, right = _root_of(a, c, e, g, b, d, f, h), _root_of(b, d, f, h, a, c, e, g)
    front, back = _root_of(a, b, e, f, c, d, g, h), _root_of(c, d, g, h, a, b, e, f)
    low, high = _root_of(a, b, c, d, e, f, g, h), _root_of(e, f, g, h, a, b, c, d)
    slopes = _slope_of(left, right) << np.int32(SLOPE)
    slopes |= _slope_of(front, back) << np.int32(SLOPE + SLOPE_BITS)
    slopes |= _slope_of(low, high) << np.int32(SLOPE + 2 * SLOPE_BITS)
    return left + right + front + back + low + high, slopes


@device
def _child_light(luminance, mask, first, octant):
    """Luminance of a cell's child, -1 for none."""
    child = first + RANKS[mask, octant]
    return np.float32(luminance[max(child, 0)]) * _STEP if child >= 0 else np.float32(-1)


@device
def _slope_of(low, high):
    """Steps of the slope between the roots of two opposite faces."""
    half = min(max(np.float32(0.5) * (high - low), np.float32(-0.5)), np.float32(0.5))
    steps = np.int32(np.float32(SLOPE_STEPS) * np.sqrt(np.float32(2) * abs(half)) + np.float32(0.5))
    return np.int32(SLOPE_STEPS) + (-steps if half < 0 else steps)


@device
def _root_of(a, b, c, d, behind_a, behind_b, behind_c, behind_d):
    """Root of the luminance of a face of a cell: of the children at it, or behind missing ones, below 0."""
    none, one = np.float32(0), np.float32(1)
    a, b = a if a >= none else behind_a, b if b >= none else behind_b
    c, d = c if c >= none else behind_c, d if d >= none else behind_d
    total = max(a, none) + max(b, none) + max(c, none) + max(d, none)
    count = (one if a >= none else none) + (one if b >= none else none)
    count += (one if c >= none else none) + (one if d >= none else none)
    return np.sqrt(total / count)
