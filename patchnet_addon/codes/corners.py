# SPDX-License-Identifier: GPL-3.0-or-later
"""Corners of a level's coded voxels in ranges of lines, so that memory does not grow with the octree.

Corners are ordered plane by plane (z), line by line (y), x fastest, as `corner_rows.py` requires of codes. A range is
several planes, or several lines of a plane with too many voxels. Its voxels are found by a walk restricted to the
range.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..octree.octree import Octree
from ..octree.side_kernels import row_of
from ..runtime.errors import SettingError
from ..runtime.kernels import device, kernel
from .brick import child_at
from .corner_rows import CodedNodes, set_corner_rows

RANGE_VOXELS = 1 << 15  # of a range, unless one line alone has more: about 2 MB of scratch and 60,000 corners
_Y, _Z = 0, 1


class Lines(NamedTuple):
    """Lines of corners with y from `low_y` to `high_y` and z from `low_z` to `high_z`, exclusive.

    The voxels around them start at y = low_y - 1 and z = low_z - 1.
    """

    low_y: int
    high_y: int
    low_z: int
    high_z: int


class CornerRange(NamedTuple):
    """Range of corners of a level, and the number of coded voxels around it."""

    level: int
    lines: Lines
    voxels: int


def corner_ranges(octree: Octree, coded: CodedNodes, level: int, most: int = RANGE_VOXELS) -> Iterator[CornerRange]:
    """Ranges of a level in order, each with at most `most` coded voxels around it, or of a single line."""
    side = 1 << level
    whole = Lines(0, side + 1, 0, side + 1)
    for low_z, high_z, voxels in _cut(_counts(octree, coded, level, whole, _Z), most):
        lines = Lines(0, side + 1, low_z, high_z)
        if voxels <= most:
            yield CornerRange(level, lines, voxels)
            continue
        for low_y, high_y, part in _cut(_counts(octree, coded, level, lines, _Y), most):
            yield CornerRange(level, Lines(low_y, high_y, low_z, high_z), part)


def find_corners(octree: Octree, coded: CodedNodes, where: CornerRange) -> np.ndarray:
    """Corners (C, 3) int32 of a range, in order."""
    corners, _, _ = _corner_keys(octree, coded, where)
    side = (1 << where.level) + 1
    return np.stack([corners % side, corners // side % side, corners // side**2], axis=1).astype(np.int32)


def write_corner_rows(octree: Octree, coded: CodedNodes, where: CornerRange, first: int, table: np.ndarray) -> int:
    """Write the rows of a range's corners, from `first` on, into the table (K, 3); returns the number of corners.

    Raises SettingError for a line of more than 65,535 corners.
    """
    corners, starts, voxels = _corner_keys(octree, coded, where)
    fits = True
    for octant, (keys, of) in enumerate(zip(starts, voxels, strict=True)):
        fits &= set_corner_rows(table, of, 2 * octant, first + np.searchsorted(corners, keys))
    if not fits:
        raise SettingError(
            f"A line of voxels on level {where.level} has more corners than the codes' table can hold: "
            "choose a smaller depth"
        )
    return len(corners)


def _corner_keys(
    octree: Octree, coded: CodedNodes, where: CornerRange
) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Keys x + y side + z side^2 of a range's corners (C,) int64, rising, with side = 2^level + 1.

    Also the corners (0, y, z) of voxels within the range, for each y + 2 z: keys, and rows of the voxels.
    """
    level, lines = where.level, where.lines
    cells, found = np.empty((where.voxels, 3), np.int64), np.empty(where.voxels, np.int64)
    _find(octree.nodes, coded, level, lines, cells, found)
    side = (1 << level) + 1
    key = cells @ np.array([1, side, side**2])
    order = np.argsort(key)
    cells, found, key = cells[order], found[order], key[order]
    starts, voxels = [], []
    for z in range(2):
        inside_z = (cells[:, 2] + z >= lines.low_z) & (cells[:, 2] + z < lines.high_z)
        for y in range(2):
            inside = inside_z & (cells[:, 1] + y >= lines.low_y) & (cells[:, 1] + y < lines.high_y)
            starts.append(key[inside] + y * side + z * side**2)
            voxels.append(found[inside])
    every = np.concatenate([start + x for start in starts for x in range(2)])
    every.sort(kind="stable")  # merges sorted runs
    return every[np.diff(every, prepend=-1) > 0], starts, voxels


def _counts(octree: Octree, coded: CodedNodes, level: int, lines: Lines, axis: int) -> np.ndarray:
    """Number of coded voxels (side + 2,) int64 around some lines by z or y, shifted by one place."""
    counts = np.zeros((1 << level) + 2, np.int64)
    _count(octree.nodes, coded, level, lines, axis, counts[1:])
    return counts


def _cut(counts: np.ndarray, most: int) -> Iterator[tuple[int, int, int]]:
    """Split places 0 to side of corners into parts (low, high, voxels around), without empty ones.

    counts: (side + 2,) voxels at place - 1; the corners of a place have those of place - 1 and place around them.
    """
    before = np.concatenate([[0], np.cumsum(counts)])  # voxels below place - 1
    low, end = 0, len(counts) - 1
    while low < end:
        high = int(np.searchsorted(before, before[low] + most, side="right")) - 2  # counts[low : high + 1] fit
        high = min(max(high, low + 1), end)
        if (voxels := int(before[high + 1] - before[low])) > 0:
            yield low, high, voxels
        low = high


@device
def _push_children(nodes, coded, level, lines, stack, top):  # type: ignore[no-untyped-def]
    """Replace the voxel on top of the stack by its coded children around the lines, the first on top.

    stack: (n, 5) int64 of node, level, x, y, z. Returns the new top.
    """
    node, at, x, y, z = stack[top, 0], stack[top, 1] + 1, stack[top, 2], stack[top, 3], stack[top, 4]
    shift = level - at
    top -= 1
    for octant in range(7, -1, -1):
        child = child_at(nodes, node, octant)
        if child < 0 or row_of(coded, child) < 0:
            continue
        child_y, child_z = 2 * y + ((octant >> 1) & 1), 2 * z + (octant >> 2)
        if (child_y << shift) >= lines.high_y or ((child_y + 1) << shift) < lines.low_y:
            continue
        if (child_z << shift) >= lines.high_z or ((child_z + 1) << shift) < lines.low_z:
            continue
        top += 1
        stack[top, 0], stack[top, 1], stack[top, 2] = child, at, 2 * x + (octant & 1)
        stack[top, 3], stack[top, 4] = child_y, child_z
    return top


@device
def _stack(coded, level):  # type: ignore[no-untyped-def]
    """Stack of a walk from the root, and its top: -1 if the root is not coded."""
    stack = np.zeros((7 * level + 8, 5), np.int64)
    return stack, 0 if row_of(coded, np.int64(0)) >= 0 else -1


@kernel
def _count(nodes, coded, level, lines, axis, counts):  # type: ignore[no-untyped-def]
    """Add the coded voxels around some lines to `counts`, by y (axis 0) or z (axis 1)."""
    stack, top = _stack(coded, level)
    while top >= 0:
        if stack[top, 1] == level:
            counts[stack[top, 3 + axis]] += 1
            top -= 1
        else:
            top = _push_children(nodes, coded, level, lines, stack, top)


@kernel
def _find(nodes, coded, level, lines, cells, found):  # type: ignore[no-untyped-def]
    """Write the coded voxels around some lines: cells (V, 3), and rows among all coded voxels (V,)."""
    stack, top = _stack(coded, level)
    count = 0
    while top >= 0:
        if stack[top, 1] < level:
            top = _push_children(nodes, coded, level, lines, stack, top)
            continue
        for axis in range(3):
            cells[count, axis] = stack[top, 2 + axis]
        found[count] = row_of(coded, stack[top, 0])
        count += 1
        top -= 1
