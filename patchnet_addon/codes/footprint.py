# SPDX-License-Identifier: GPL-3.0-or-later
"""Footprint of a pixel on the children of a voxel: how much of it each covers, were it alone (methods 11.2).

Cells are drawn onto the picture plane as boxes along its axes, of the area and the proportions of their outline there;
a pixel is a square. The eight children of the voxel are seen by the faces of their own children, of which those
show that no other stands before. Of a leaf with a box only that part of a face counts that the box covers, and the rest
shows what stands behind. Of the cells around the voxel `outer_cells.py` measures those that are there.

Everything is in the ray frame (`ray_frame.py`). A tile has pixels as columns, and in rows what kernels read of them.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from ..network.compiled_layers import TILE, empty_values
from ..network.kinds import CHILDREN
from ..runtime.kernels import device, lean_device
from ..runtime.vectors import LANES, larger, less, load, select, smaller, splat, store
from .outer_cells import SMALL
from .ray_frame import CELLS, SIDE

ABSENT = np.float32(-1)  # the luminance of a cell that is empty

_RIGHT, _UP, _START, _WIDE, _HIGH, _HALF = 0, 3, 6, 8, 11, 14  # rows of what a frame holds
FRAME_ROWS = 15
_COLUMNS = 12  # of two grandchildren in a child, four along each axis
_EVERY_LANE = (1 << LANES) - 1


def _columns() -> tuple[np.ndarray, np.ndarray]:
    """Columns of all children, along x first: places (8 * 12 * 3,) int64, the axis and where in a tile the rows of the
    first and of the second begin; and middles (8 * 12 * 6,) float32 of the two faces that a ray meets."""
    places, middles = [], []
    for child, axis, column in itertools.product(range(CHILDREN), range(3), range(4)):
        near = 2 * (child >> np.arange(3) & 1)
        near[[k for k in range(3) if k != axis]] += column & 1, column >> 1
        ahead = np.arange(3) == axis
        rows = [cell @ np.array([1, SIDE, SIDE**2]) * LANES for cell in (near, near + ahead)]
        places += [axis, *rows]
        middles += [(cell + np.where(ahead, 0, 0.5)) / SIDE for cell in (near, near + ahead)]
    return np.array(places), np.concatenate(middles).astype(np.float32)


_PLACES, _MIDDLES = _columns()


class FootprintTile(NamedTuple):
    """What a tile of pixels is measured with, rows of TILE float32.

    frame: 15 rows, see `set_frame`. fine: 64 rows, luminances of the voxel's grandchildren, ABSENT for empty ones.
    shares: of each of them three rows, of their faces across each axis the part that is covered, where has_boxes (1,)
    bool says that any of them has a box. Of `fine` and `shares` the rows of LANES pixels stand together, see
    `fine_place`: with rows of TILE what is written of a pixel falls into few sets of the processor's cache.
    """

    frame: np.ndarray
    fine: np.ndarray
    shares: np.ndarray
    has_boxes: np.ndarray


@device
def empty_footprint_tile():
    """Tile to measure in, after `clear_tile`."""
    frame = empty_values(FRAME_ROWS)
    frame[:] = 1  # no pixel of which a column is never written is of size 0
    return FootprintTile(frame, empty_values(CELLS), empty_values(3 * CELLS), np.empty(1, np.bool_))


@lean_device
def clear_tile(tile, covered, shown):  # type: ignore[no-untyped-def]
    """Empty all cells of a tile, before those of its pixels are written; covered, shown: see `measure_tile`."""
    tile.fine[:] = ABSENT
    tile.has_boxes[0] = False
    covered[CHILDREN * TILE : CELLS * TILE] = 0
    shown[CHILDREN * TILE : CELLS * TILE] = 0


@lean_device
def fine_place(place):  # type: ignore[no-untyped-def]
    """Index in `fine` of a pixel's first grandchild; the next one stands LANES behind it.

    Its three rows of `shares` begin there, too, but for the pixel's lane three times as far.
    """
    lane = place % LANES
    return (place - lane) * CELLS, lane


@lean_device
def set_frame(frame, axes, entry, direction, up, ratio, view, place):  # type: ignore[no-untyped-def]
    """Write how a pixel sees cells into column `place` of a tile's `frame`, and its view in the ray frame into `view`.

    axes: three, of the ray frame. entry, direction, up: (3,) as in `PatchRays`, ratio a number. view: (9 * TILE,)
    direction, entry point from -1 to 1, up. Rows of `frame`: pixels to the right and up per voxel side, where the
    voxel's lowest corner lies, half widths and half heights of a grandchild's faces across each axis, and the pixel's
    half side.
    """
    right = (
        direction[1] * up[2] - direction[2] * up[1],
        direction[2] * up[0] - direction[0] * up[2],
        direction[0] * up[1] - direction[1] * up[0],
    )
    start_right, start_up = np.float32(0), np.float32(0)
    sum_right, sum_up = np.float32(0), np.float32(0)
    for k in range(3):
        axis = axes[k]
        sign = np.float32(-1) if direction[axis] < 0 else np.float32(1)
        point = np.float32(1) - entry[axis] if sign < 0 else entry[axis]
        to_right, to_up, along = sign * right[axis], sign * up[axis], sign * direction[axis]
        frame[(_RIGHT + k) * TILE + place], frame[(_UP + k) * TILE + place] = to_right, to_up
        view[k * TILE + place], view[(6 + k) * TILE + place] = along, to_up
        view[(3 + k) * TILE + place] = np.float32(2) * point - np.float32(1)
        start_right -= point * to_right
        start_up -= point * to_up
        sum_right += abs(to_right)
        sum_up += abs(to_up)
    frame[_START * TILE + place], frame[(_START + 1) * TILE + place] = start_right, start_up
    for k in range(3):
        wide = np.float32(0.125) * (sum_right - abs(frame[(_RIGHT + k) * TILE + place]))
        high = np.float32(0.125) * (sum_up - abs(frame[(_UP + k) * TILE + place]))
        area = np.float32(0.0625) * view[k * TILE + place]
        scale = np.float32(np.sqrt(area / (np.float32(4) * wide * high + np.float32(SMALL))))
        frame[(_WIDE + k) * TILE + place], frame[(_HIGH + k) * TILE + place] = wide * scale, high * scale
    frame[_HALF * TILE + place] = np.float32(0.5) * ratio


@lean_device
def measure_tile(tile, covered, shown):  # type: ignore[no-untyped-def]
    """Write the share of each pixel that the 8 children cover, and their luminances.

    covered, shown: (64 * TILE,) float32, rows of children, then of outer cells, which stay as they are.
    """
    frame, boxed = tile.frame, tile.has_boxes[0]
    for pixel in range(0, TILE, LANES):
        seen = _seen_by(frame, pixel)
        for child in range(CHILDREN):
            if boxed:
                sums = _child_with_boxes(tile, seen, child, pixel)
            else:
                sums = _child_of_faces(tile, seen, child, pixel)
            _store_child(seen, sums, covered, shown, child * TILE + pixel)


@lean_device
def _seen_by(frame, pixel):  # type: ignore[no-untyped-def]
    """Vectors of how pixels from `pixel` on see cells: to the right, up, where the voxel starts, and half sides."""
    at = _UP * TILE + pixel
    right = load(frame, pixel), load(frame, pixel + TILE), load(frame, pixel + 2 * TILE)
    up = load(frame, at), load(frame, at + TILE), load(frame, at + 2 * TILE)
    start = load(frame, _START * TILE + pixel), load(frame, (_START + 1) * TILE + pixel)
    return right, up, start, load(frame, _HALF * TILE + pixel)


@lean_device
def _child_of_faces(tile, seen, child, pixel):  # type: ignore[no-untyped-def]
    """Sums, over the columns of a child's own children, of the area that the first one there covers, and its light."""
    frame, fine, none = tile.frame, tile.fine, splat(np.float32(0))
    covered, shown = none, none
    for column in range(_COLUMNS * child, _COLUMNS * (child + 1)):
        axis, near, far = _columns_of(column, pixel)
        front, back = load(fine, near), load(fine, far)
        empty = less(front, none)
        light = select(empty, back, front)
        area = _overlap(frame, seen, _middle(column, empty), axis, pixel)
        area = select(less(light, none), none, area)
        covered, shown = covered + area, shown + area * light
    return covered, shown


@lean_device
def _child_with_boxes(tile, seen, child, pixel):  # type: ignore[no-untyped-def]
    """Sums as of `_child_of_faces`: of the second one in a column what the box of the first leaves free."""
    frame, fine, shares = tile.frame, tile.fine, tile.shares
    none, whole = splat(np.float32(0)), splat(np.float32(1))
    covered, shown = none, none
    for column in range(_COLUMNS * child, _COLUMNS * (child + 1)):
        axis, near, far = _columns_of(column, pixel)
        front, back = load(fine, near), load(fine, far)
        before = select(less(front, none), none, load(shares, 3 * near + axis * LANES))
        behind = load(shares, 3 * far + axis * LANES) * (whole - before)
        behind = select(less(back, none), none, behind)
        first = before * _overlap(frame, seen, _middle(column, 0), axis, pixel)
        second = behind * _overlap(frame, seen, _middle(column, _EVERY_LANE), axis, pixel)
        covered, shown = covered + (first + second), shown + (first * front + second * back)
    return covered, shown


@lean_device
def _columns_of(column, pixel):  # type: ignore[no-untyped-def]
    """Axis of a column, and where the rows of its two grandchildren have a pixel."""
    return _PLACES[3 * column], _PLACES[3 * column + 1] + pixel * CELLS, _PLACES[3 * column + 2] + pixel * CELLS


@lean_device
def _middle(column, behind):  # type: ignore[no-untyped-def]
    """Middle of the face of a column's first grandchild, in lanes of `behind` of the second's, as three vectors."""
    x = select(behind, splat(_MIDDLES[6 * column + 3]), splat(_MIDDLES[6 * column]))
    y = select(behind, splat(_MIDDLES[6 * column + 4]), splat(_MIDDLES[6 * column + 1]))
    return x, y, select(behind, splat(_MIDDLES[6 * column + 5]), splat(_MIDDLES[6 * column + 2]))


@lean_device
def _overlap(frame, seen, middle, axis, pixel):  # type: ignore[no-untyped-def]
    """Area of pixels, in sides of the voxel squared, that a face across an axis covers."""
    (right_x, right_y, right_z), (up_x, up_y, up_z), (start_right, start_up), half = seen
    x, y, z = middle
    none = splat(np.float32(0))
    right = start_right + x * right_x + (y * right_y + z * right_z)
    above = start_up + x * up_x + (y * up_y + z * up_z)
    wide, high = load(frame, (_WIDE + axis) * TILE + pixel), load(frame, (_HIGH + axis) * TILE + pixel)
    across = smaller(right + wide, half) - larger(right - wide, none - half)
    up = smaller(above + high, half) - larger(above - high, none - half)
    return larger(across, none) * larger(up, none)


@lean_device
def _store_child(seen, sums, covered, shown, at):  # type: ignore[no-untyped-def]
    """Store what a child covers of each pixel, and its luminance, from an index on."""
    half, none = seen[3], splat(np.float32(0))
    area, light = sums
    store(shown, at, select(less(none, area), light / area, none))
    store(covered, at, area / (splat(np.float32(4)) * half * half))
