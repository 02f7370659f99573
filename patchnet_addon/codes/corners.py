# SPDX-License-Identifier: GPL-3.0-or-later
"""Corners of a level's coded voxels, range of lines by range of lines, so that memory does not grow with the octree.

Corners stand plane by plane (z), line by line (y), x fastest: the order of codes that `corner_rows.py` relies on. A
range is some whole planes, or some lines of one plane where that has too many voxels. Its voxels are found by a walk
that goes down only where the range lies; they come in Morton order, in which those of a line already ascend, so two
counting sorts put them in order of lines. Each line of corners is then merged of the four lines of voxels around it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..octree.octree import Octree
from ..runtime.errors import SettingError
from ..runtime.kernels import device, kernel
from .brick import child_at
from .coded_nodes import CodedNodes, coded_row, is_coded
from .corner_rows import COLUMNS, write_corner_row

RANGE_VOXELS = 1 << 15  # of a range, unless one line alone has more: about 2 MB of scratch and 60,000 corners
_Y, _Z = 0, 1


class Lines(NamedTuple):
    """Lines of corners with y from `low_y` to `high_y` and z from `low_z` to `high_z`, those excluded.

    The voxels around them have y from low_y - 1 and z from low_z - 1 on.
    """

    low_y: int
    high_y: int
    low_z: int
    high_z: int


class CornerRange(NamedTuple):
    """Range of corners of a level, and how many coded voxels lie around it."""

    level: int
    lines: Lines
    voxels: int


class _Sorted(NamedTuple):
    """Voxels of a range in order of z, y, x, and where lines and planes that have any begin among them.

    x, row: (V,) int64, place in the line and number among all coded voxels. line_first, plane_first: one number more
    than there are lines or planes. line_y, plane_z: of the voxels.
    """

    x: np.ndarray
    row: np.ndarray
    line_first: np.ndarray
    line_y: np.ndarray
    plane_first: np.ndarray
    plane_z: np.ndarray


class _Found(NamedTuple):
    """Corners (C, 3) int32 and table (K, 3) uint32 to write, each if it is not empty; `state`: corners so far, steps
    that the table cannot hold."""

    corners: np.ndarray
    table: np.ndarray
    state: np.ndarray


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
    corners = np.empty((8 * where.voxels, 3), np.int32)
    state = _run(octree, coded, where, 0, _Found(corners, np.empty((0, COLUMNS), np.uint32), np.zeros(2, np.int64)))
    return corners[: state[0]]


def write_corner_rows(octree: Octree, coded: CodedNodes, where: CornerRange, first: int, table: np.ndarray) -> int:
    """Write the rows of a range's corners, from `first` on, into the table (K, 3); returns how many they are.

    Raises SettingError where a line of corners is too long for the table: with more than 65,535 of them.
    """
    state = _run(octree, coded, where, first, _Found(np.empty((0, 3), np.int32), table, np.zeros(2, np.int64)))
    if state[1]:
        raise SettingError(
            f"A line of voxels on level {where.level} has more corners than the codes' table can hold: "
            "choose a smaller depth"
        )
    return int(state[0])


def _run(octree: Octree, coded: CodedNodes, where: CornerRange, first: int, found: _Found) -> np.ndarray:
    _find(octree.nodes, coded, where.level, where.lines, where.voxels, first, found)
    return found.state


def _counts(octree: Octree, coded: CodedNodes, level: int, lines: Lines, axis: int) -> np.ndarray:
    """Coded voxels (side + 2,) int64 by z or y, one place higher, among those around some lines."""
    counts = np.zeros((1 << level) + 2, np.int64)
    _count(octree.nodes, coded.bits, level, lines, axis, counts[1:])
    return counts


def _cut(counts: np.ndarray, most: int) -> Iterator[tuple[int, int, int]]:
    """Cut places 0 to side of corners into parts, those without voxels left out: low, high, voxels around.

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
def _push_children(nodes, bits, level, lines, stack, top):  # type: ignore[no-untyped-def]
    """Replace the voxel on top of the stack by its coded children around the lines, the first on top.

    stack: (n, 5) int64 of node, level, x, y, z. Returns where the top is then.
    """
    node, at, x, y, z = stack[top, 0], stack[top, 1] + 1, stack[top, 2], stack[top, 3], stack[top, 4]
    shift = level - at
    top -= 1
    for octant in range(7, -1, -1):
        child = child_at(nodes, node, octant)
        if child < 0 or not is_coded(bits, child):
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
def _stack(bits, level):  # type: ignore[no-untyped-def]
    """Stack of a walk from the root, and its top: -1 if the root is not coded."""
    stack = np.zeros((7 * level + 8, 5), np.int64)
    return stack, 0 if is_coded(bits, np.int64(0)) else -1


@kernel
def _count(nodes, bits, level, lines, axis, counts):  # type: ignore[no-untyped-def]
    """Add the coded voxels around some lines to `counts`, by y (axis 0) or z (axis 1)."""
    stack, top = _stack(bits, level)
    while top >= 0:
        if stack[top, 1] == level:
            counts[stack[top, 3 + axis]] += 1
            top -= 1
        else:
            top = _push_children(nodes, bits, level, lines, stack, top)


@kernel
def _find(nodes, coded, level, lines, voxels, first, found):  # type: ignore[no-untyped-def]
    """Find the corners of some lines; `state` gets their number and that of steps which the table cannot hold."""
    places, rows = np.empty((3, voxels), np.int32), np.empty(voxels, np.int64)
    stack, top = _stack(coded.bits, level)
    count = 0
    while top >= 0:
        if stack[top, 1] < level:
            top = _push_children(nodes, coded.bits, level, lines, stack, top)
            continue
        for axis in range(3):
            places[axis, count] = stack[top, 2 + axis]
        rows[count] = coded_row(coded.bits, coded.before, stack[top, 0])
        count += 1
        top -= 1
    order = _sort_by(places[1], np.arange(count), lines.low_y - 1, lines.high_y)
    order = _sort_by(places[2], order, lines.low_z - 1, lines.high_z)
    _merge_planes(_in_lines(places, rows, order), lines, first, found)


@device
def _sort_by(values, order, low, high):  # type: ignore[no-untyped-def]
    """Order with `values`, from `low` to below `high`, ascending; what is equal stays as it was: a counting sort."""
    starts = np.zeros(high - low + 1, np.int64)
    for item in order:
        starts[values[item] - low + 1] += 1
    for value in range(1, len(starts)):
        starts[value] += starts[value - 1]
    result = np.empty(len(order), np.int64)
    for item in order:
        place = values[item] - low
        result[starts[place]] = item
        starts[place] += 1
    return result


@device
def _in_lines(places, rows, order):  # type: ignore[no-untyped-def]
    """Group voxels in order of z, y, x, as `_Sorted` has them."""
    count = len(order)
    x, row = np.empty(count, np.int64), np.empty(count, np.int64)
    line_first, line_y = np.empty(count + 1, np.int64), np.empty(count, np.int64)
    plane_first, plane_z = np.empty(count + 1, np.int64), np.empty(count, np.int64)
    lines = planes = 0
    for place in range(count):
        item = order[place]
        x[place], row[place] = places[0, item], rows[item]
        y, z = places[1, item], places[2, item]
        new_plane = planes == 0 or plane_z[planes - 1] != z
        if new_plane:
            plane_first[planes], plane_z[planes] = lines, z
            planes += 1
        if new_plane or line_y[lines - 1] != y:
            line_first[lines], line_y[lines] = place, y
            lines += 1
    line_first[lines], plane_first[planes] = count, lines
    return _Sorted(x, row, line_first[: lines + 1], line_y[:lines], plane_first[: planes + 1], plane_z[:planes])


@device
def _merge_planes(voxels, lines, first, found):  # type: ignore[no-untyped-def]
    """Find corners plane by plane: each lies between the voxels of the plane below it and those of the plane above."""
    plane_z, plane_first = voxels.plane_z, voxels.plane_first
    planes = len(plane_z)
    cursor, end = np.empty(4, np.int64), np.empty(4, np.int64)
    low = high = 0
    while low < planes:
        z = plane_z[low] + 1
        if high < planes and plane_z[high] < z:
            z = plane_z[high]
        cursor[:], end[:] = 0, 0
        if high < planes and plane_z[high] == z:  # the plane above: corners are its voxels' with octants of z = 0
            cursor[:2], end[:2] = plane_first[high], plane_first[high + 1]
            high += 1
        if plane_z[low] + 1 == z:
            cursor[2:], end[2:] = plane_first[low], plane_first[low + 1]
            low += 1
        if lines.low_z <= z < lines.high_z:
            _merge_lines(voxels, cursor, end, lines, z, first, found)


@device
def _merge_lines(voxels, cursor, end, lines, z, first, found):  # type: ignore[no-untyped-def]
    """Find a plane's corners line by line.

    cursor, end: (4,) lines of voxels still to come, for each pair of corners (0, y, z) of these, y + 2 z of it.
    """
    line_y, line_first = voxels.line_y, voxels.line_first
    voxel, last = np.empty(4, np.int64), np.empty(4, np.int64)
    while True:
        y = np.int64(-1)
        for pair in range(4):
            if cursor[pair] < end[pair] and (y < 0 or line_y[cursor[pair]] + (pair & 1) < y):
                y = line_y[cursor[pair]] + (pair & 1)
        if y < 0:
            return
        for pair in range(4):
            voxel[pair], last[pair] = 0, 0
            if cursor[pair] < end[pair] and line_y[cursor[pair]] + (pair & 1) == y:
                voxel[pair], last[pair] = line_first[cursor[pair]], line_first[cursor[pair] + 1]
                cursor[pair] += 1
        if lines.low_y <= y < lines.high_y:
            _merge_line(voxels.x, voxels.row, voxel, last, (y, z), first, found)


@device
def _merge_line(xs, rows, voxel, end, line, first, found):  # type: ignore[no-untyped-def]
    """Find a line's corners: at x and x + 1 of each voxel of the four lines around it, from `voxel` to `end` (4,)."""
    corners, table, state = found.corners, found.table, found.state
    count, latest = state[0], np.int64(-1)
    while True:
        x = np.int64(-1)
        for pair in range(4):
            if voxel[pair] < end[pair] and (x < 0 or xs[voxel[pair]] < x):
                x = xs[voxel[pair]]
        if x < 0:
            break
        for corner in range(x if latest < x else x + 1, x + 2):
            if len(corners) > 0:
                corners[count, 0], corners[count, 1], corners[count, 2] = corner, line[0], line[1]
            count += 1
        latest = x + 1
        for pair in range(4):
            if voxel[pair] < end[pair] and xs[voxel[pair]] == x:
                # The corner at x is the last but one.
                if len(table) > 0 and not write_corner_row(table, rows[voxel[pair]], 2 * pair, first + count - 2):
                    state[1] += 1
                voxel[pair] += 1
    state[0] = count
