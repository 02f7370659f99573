# SPDX-License-Identifier: GPL-3.0-or-later
"""Footprint of a pixel on the children of a voxel: the share of the pixel that each alone covers (methods 11.2).

Cells are projected onto the picture plane as axis-aligned boxes with the area and the proportions of their outline; a
pixel is a square. The eight children of the voxel are represented by the unoccluded faces of their own children. A leaf
with a box covers only the box's part of a face; the rest shows the cell behind. `outer_cells.py` measures the existing
cells around the voxel.

All values are in the ray frame (`ray_frame.py`). A tile has pixels as columns and their values as rows.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from ..network.compiled_layers import TILE, empty_values
from ..network.kinds import CHILDREN
from ..runtime.kernels import array_device, device
from ..runtime.vectors import LANES, less, load, select, splat, store
from .outer_cells import SMALL, inside_pixel
from .ray_frame import CELLS, SIDE

ABSENT = np.float32(-1)  # luminance of an empty cell

_RIGHT, _UP, _START, _WIDE, _HIGH, _HALF = 0, 3, 6, 8, 11, 14  # rows of a frame
FRAME_ROWS = 15
_COLUMNS = 12  # pairs of grandchildren in a child, four along each axis
_EVERY_LANE = (1 << LANES) - 1


def _columns() -> tuple[np.ndarray, np.ndarray]:
    """Columns of all children, along x first: places (8 * 12 * 3,) int64, the axis and the offsets in a tile of the
    first and the second one's rows; and middles (8 * 12 * 6,) float32 of the two faces that a ray hits.
    """
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


class PixelRay(NamedTuple):
    """Ray of a pixel: entry point in the voxel, direction and up (3,), and ratio, see `Hits`."""

    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray | np.float32


class FootprintTile(NamedTuple):
    """Inputs to measure a tile of pixels, rows of TILE float32.

    frame: 15 rows, see `set_frame`. fine: 64 rows, luminances of the voxel's grandchildren, ABSENT for empty ones.
    shares: three rows for each of them, covered part of their faces across each axis, undefined for empty ones. In
    `fine` and `shares` the rows of LANES pixels are adjacent, see `fine_place`: with rows of TILE, writes of a pixel
    would map to few cache sets.
    """

    frame: np.ndarray
    fine: np.ndarray
    shares: np.ndarray


@array_device
def empty_footprint_tile():
    """Allocate a tile; call `clear_tile` before use."""
    frame = empty_values(FRAME_ROWS)
    frame[:] = 1  # columns never written must not have pixels of size 0
    return FootprintTile(frame, empty_values(CELLS), empty_values(3 * CELLS))


@device
def clear_tile(tile, covered, shown):
    """Mark all cells of a tile as empty; covered, shown: see `measure_tile`."""
    tile.fine[:] = ABSENT
    covered[CHILDREN * TILE : CELLS * TILE] = 0
    shown[CHILDREN * TILE : CELLS * TILE] = 0


@device
def fine_place(place):
    """Index in `fine` of a pixel's first grandchild; the next one follows after LANES.

    Its three rows of `shares` start at three times that index, without the pixel's lane.
    """
    lane = place % LANES
    return (place - lane) * CELLS, lane


@device
def set_frame(frame, axes, ray, view, place):
    """Write the projection of a pixel into column `place` of a tile's `frame`, and its view in the ray frame into
    `view`.

    axes: three, of the ray frame. ray: `PixelRay`. view: (9 * TILE,) direction, entry point from -1 to 1, up. Rows of
    `frame`: pixels to the right and up per voxel side, position of the voxel's lowest corner, half widths and half
    heights of a grandchild's faces across each axis, and the pixel's half side.
    """
    entry, direction, up, ratio = ray
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


@device
def measure_tile(tile, covered, shown):
    """Write the share of each pixel that the 8 children cover, and their luminances.

    covered, shown: (64 * TILE,) float32, rows of children, then of outer cells, which are unchanged.
    """
    for pixel in range(0, TILE, LANES):
        seen = _seen_by(tile.frame, pixel)
        for child in range(CHILDREN):
            sums = _sums_of_child(tile, seen, child, pixel)
            _store_child(seen, sums, covered, shown, child * TILE + pixel)


@device
def _seen_by(frame, pixel):
    """Vectors of the projection of pixels from `pixel` on: right, up, start of the voxel, and half sides."""
    at = _UP * TILE + pixel
    right = load(frame, pixel), load(frame, pixel + TILE), load(frame, pixel + 2 * TILE)
    up = load(frame, at), load(frame, at + TILE), load(frame, at + 2 * TILE)
    start = load(frame, _START * TILE + pixel), load(frame, (_START + 1) * TILE + pixel)
    return right, up, start, load(frame, _HALF * TILE + pixel)


@device
def _sums_of_child(tile, seen, child, pixel):
    """Sums, over the columns of a child's own children, of the covered area, and its light.

    The second one of a column covers the part that the box of the first leaves free.
    """
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


@device
def _columns_of(column, pixel):
    """Axis of a column, and places of a pixel in the rows of its two grandchildren."""
    return _PLACES[3 * column], _PLACES[3 * column + 1] + pixel * CELLS, _PLACES[3 * column + 2] + pixel * CELLS


@device
def _middle(column, behind):
    """Middle of the face of a column's first grandchild, in lanes of `behind` of the second's, as three vectors."""
    x = select(behind, splat(_MIDDLES[6 * column + 3]), splat(_MIDDLES[6 * column]))
    y = select(behind, splat(_MIDDLES[6 * column + 4]), splat(_MIDDLES[6 * column + 1]))
    return x, y, select(behind, splat(_MIDDLES[6 * column + 5]), splat(_MIDDLES[6 * column + 2]))


@device
def _overlap(frame, seen, middle, axis, pixel):
    """Area of pixels, in squared sides of the voxel, covered by a face across an axis."""
    (right_x, right_y, right_z), (up_x, up_y, up_z), (start_right, start_up), half = seen
    x, y, z = middle
    right = start_right + x * right_x + (y * right_y + z * right_z)
    above = start_up + x * up_x + (y * up_y + z * up_z)
    wide, high = load(frame, (_WIDE + axis) * TILE + pixel), load(frame, (_HIGH + axis) * TILE + pixel)
    return inside_pixel(right, wide, half) * inside_pixel(above, high, half)


@device
def _store_child(seen, sums, covered, shown, at):
    """Store the share of each pixel that a child covers, and its luminance, from an index on."""
    half, none = seen[3], splat(np.float32(0))
    area, light = sums
    store(shown, at, select(less(none, area), light / area, none))
    store(covered, at, area / (splat(np.float32(4)) * half * half))
