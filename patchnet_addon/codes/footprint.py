# SPDX-License-Identifier: GPL-3.0-or-later
"""Footprint of a pixel on the children of a voxel: how much of it each covers, were it alone (methods 11.2).

Cells are drawn onto the picture plane as boxes along its axes, of the area and the proportions of their outline there;
a pixel is a square. The eight children of the voxel are seen by the faces of their own children, of which those
show that no other stands before. Of a leaf with a box only that part of a face counts that the box covers, and the rest
shows what stands behind. Of the cells around the voxel `outer_cells.py` measures those that are there.

Everything is in the ray frame (`ray_frame.py`). A tile has pixels as columns, and in rows what kernels read of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..network.compiled_layers import TILE
from ..network.kinds import CHILDREN
from ..octree.leaf_boxes import STEPS, covered_steps
from ..runtime.kernels import device, lean_device
from .outer_cells import SMALL
from .ray_frame import CELLS, SIDE, ray_frames

ABSENT = np.float32(-1)  # the luminance of a cell that is empty

_RIGHT, _UP, _START, _WIDE, _HIGH, _HALF = 0, 3, 6, 8, 11, 14  # rows of what a frame holds
FRAME_ROWS = 15


class FootprintTile(NamedTuple):
    """What a tile of pixels is measured with, rows of TILE float32.

    frame: 15 rows, see `set_frame`. fine: 64 rows, luminances of the voxel's grandchildren, ABSENT for empty ones.
    shares: 3 times 64 rows, of their faces across each axis the part that is covered, where has_boxes (1,) bool says
    that any of them has a box.
    """

    frame: np.ndarray
    fine: np.ndarray
    shares: np.ndarray
    has_boxes: np.ndarray


@device
def empty_footprint_tile():
    """Tile to measure in, after `clear_tile`."""
    frame, fine = np.ones(FRAME_ROWS * TILE, np.float32), np.empty(CELLS * TILE, np.float32)
    return FootprintTile(frame, fine, np.empty(3 * CELLS * TILE, np.float32), np.empty(1, np.bool_))


@lean_device
def clear_tile(tile, covered, shown):  # type: ignore[no-untyped-def]
    """Empty all cells of a tile, before those of its pixels are written; covered, shown: see `measure_tile`."""
    tile.fine[:] = ABSENT
    tile.has_boxes[0] = False
    covered[CHILDREN * TILE : CELLS * TILE] = 0
    shown[CHILDREN * TILE : CELLS * TILE] = 0


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
def place_box(tile, cell, place, boxes, row, axes):  # type: ignore[no-untyped-def]
    """Write what the box of a leaf covers of the faces of a cell of the ray's frame, in column `place`.

    boxes, row: the box, in octree axes. axes: of the ray frame.
    """
    shares, has_boxes = tile.shares, tile.has_boxes
    if not has_boxes[0]:
        shares[:] = 1
        has_boxes[0] = True
    at = cell * TILE + place
    covered, scale = covered_steps(boxes, row), np.float32(1 / STEPS**2)
    for k in range(3):
        shares[k * CELLS * TILE + at] = np.float32(covered[axes[k]]) * scale


@lean_device
def measure_tile(tile, covered, shown):  # type: ignore[no-untyped-def]
    """Write the share of each pixel that the 8 children cover, and their luminances.

    covered, shown: (64 * TILE,) float32, rows of children, then of outer cells, which stay as they are.
    """
    for child in range(CHILDREN):
        at = slice(child * TILE, (child + 1) * TILE)
        _measure_child(tile, child, covered[at], shown[at])


@lean_device
def _measure_child(tile, child, covered, shown):  # type: ignore[no-untyped-def]
    frame = tile.frame
    boxed = tile.has_boxes[0]
    covered[:] = 0
    shown[:] = 0
    quarter, eighth = np.float32(0.25), np.float32(0.125)
    x, y, z = 2 * (child & 1), 2 * ((child >> 1) & 1), 2 * (child >> 2)  # its first cell of 4x4x4
    for axis in range(3):
        ahead = SIDE**axis
        for column in range(4):
            i, j = column & 1, column >> 1
            a, b, c = x + (0 if axis == 0 else i), y + (0 if axis == 1 else (i if axis == 0 else j)), z
            c += 0 if axis == 2 else j
            near = (a + SIDE * (b + SIDE * c)) * TILE
            far = near + ahead * TILE
            u = quarter * np.float32(a) + (np.float32(0) if axis == 0 else eighth)
            v = quarter * np.float32(b) + (np.float32(0) if axis == 1 else eighth)
            w = quarter * np.float32(c) + (np.float32(0) if axis == 2 else eighth)
            if boxed:
                _add_boxes(tile, (near, far), (u, v, w), axis, covered, shown)
            else:
                _add_faces(tile, (near, far), (u, v, w), axis, covered, shown)
    for pixel in range(TILE):
        half = frame[_HALF * TILE + pixel]
        shown[pixel] = shown[pixel] / covered[pixel] if covered[pixel] > 0 else np.float32(0)
        covered[pixel] = covered[pixel] / (np.float32(4) * half * half)


@lean_device
def _add_faces(tile, column, middle, axis, covered, shown):  # type: ignore[no-untyped-def]
    """Add what the first of two grandchildren shows that stand behind each other along an axis.

    column: first places of their rows. middle: of the face of the first.
    """
    frame, fine = tile.frame, tile.fine
    near, far = column
    u, v, w = middle
    quarter, none = np.float32(0.25), np.float32(0)
    du, dv, dw = quarter if axis == 0 else none, quarter if axis == 1 else none, quarter if axis == 2 else none
    for pixel in range(TILE):
        front, back = fine[near + pixel], fine[far + pixel]
        first = _overlap(frame, pixel, u, v, w, axis)
        second = _overlap(frame, pixel, u + du, v + dv, w + dw, axis)
        light = front if front >= 0 else back
        area = (first if front >= 0 else second) if light >= 0 else none
        covered[pixel] += area
        shown[pixel] += area * light


@lean_device
def _add_boxes(tile, column, middle, axis, covered, shown):  # type: ignore[no-untyped-def]
    """Add what two grandchildren show, as `_add_faces`: of the second what the box of the first leaves free."""
    frame, fine, shares = tile.frame, tile.fine, tile.shares
    near, far = column
    u, v, w = middle
    quarter, none = np.float32(0.25), np.float32(0)
    du, dv, dw = quarter if axis == 0 else none, quarter if axis == 1 else none, quarter if axis == 2 else none
    of_axis = axis * CELLS * TILE
    for pixel in range(TILE):
        front, back = fine[near + pixel], fine[far + pixel]
        before = shares[of_axis + near + pixel] if front >= 0 else none
        behind = shares[of_axis + far + pixel] * (np.float32(1) - before) if back >= 0 else none
        first = before * _overlap(frame, pixel, u, v, w, axis)
        second = behind * _overlap(frame, pixel, u + du, v + dv, w + dw, axis)
        covered[pixel] += first + second
        shown[pixel] += first * front + second * back


@lean_device
def _overlap(frame, pixel, x, y, z, axis):  # type: ignore[no-untyped-def]
    """Area of the pixel, in sides of the voxel squared, that a face about (x, y, z) covers.

    axis: which the face is across.
    """
    right = frame[_START * TILE + pixel] + x * frame[pixel]
    right += y * frame[(_RIGHT + 1) * TILE + pixel] + z * frame[(_RIGHT + 2) * TILE + pixel]
    above = frame[(_START + 1) * TILE + pixel] + x * frame[_UP * TILE + pixel]
    above += y * frame[(_UP + 1) * TILE + pixel] + z * frame[(_UP + 2) * TILE + pixel]
    wide, high = frame[(_WIDE + axis) * TILE + pixel], frame[(_HIGH + axis) * TILE + pixel]
    half = frame[_HALF * TILE + pixel]
    across = min(right + wide, half) - max(right - wide, -half)
    up = min(above + high, half) - max(above - high, -half)
    return max(across, np.float32(0)) * max(up, np.float32(0))


def footprint_reference(
    fine: np.ndarray,
    entry: np.ndarray,
    direction: np.ndarray,
    up: np.ndarray,
    ratio: np.ndarray,
    shares: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """View (N, 9), coverage (N, 8) and luminances (N, 8), float32, of a voxel's children, in NumPy.

    fine: (N, 64) luminances in the ray frame, ABSENT for none. entry, direction, up: (N, 3) in octree axes.
    ratio: (N,). shares: (N, 3, 64) of the faces across each axis of the ray frame, 1 without them.
    """
    _, axes, signs = ray_frames(direction)

    def turned(vectors: np.ndarray) -> np.ndarray:
        return signs * np.take_along_axis(vectors, axes, 1)

    right, above = turned(np.cross(direction, up)), turned(up)
    along, point = turned(direction), turned(entry - 0.5) + 0.5
    covered, shown = np.zeros((len(fine), CHILDREN)), np.zeros((len(fine), CHILDREN))
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        wide, high = (0.125 * np.abs(plane[:, others]).sum(axis=1) for plane in (right, above))
        area = along[:, axis] / 16
        for cell in range(CELLS):
            place = np.array([cell // SIDE**k % SIDE for k in range(3)])
            free = np.ones(len(fine))
            if place[axis] % 2:
                ahead = cell - SIDE**axis
                free = np.where(fine[:, ahead] >= 0, 1 - (1 if shares is None else shares[:, axis, ahead]), 1)
            free *= 1 if shares is None else shares[:, axis, cell]
            middle = (place + 0.5) / SIDE
            middle[axis] -= 0.125  # the face that the ray meets
            seen = _box_overlap(middle - point, (right, above), (wide, high), area, ratio)
            seen = np.where(fine[:, cell] >= 0, free * seen, 0)
            child = (place // 2) @ np.array([1, 2, 4])
            covered[:, child] += seen
            shown[:, child] += seen * fine[:, cell]
    light = np.divide(shown, covered, out=np.zeros_like(shown), where=covered > 0)
    view = np.concatenate([along, 2 * point - 1, above], axis=1)
    return view.astype(np.float32), (covered / ratio[:, None] ** 2).astype(np.float32), light.astype(np.float32)


def _box_overlap(
    offset: np.ndarray,
    plane: tuple[np.ndarray, ...],
    halves: tuple[np.ndarray, ...],
    area: np.ndarray,
    ratio: np.ndarray,
) -> np.ndarray:
    """Area (N,) of pixels that a box covers, whose middle is at offsets (N, 3) from the entry point.

    plane: right and up (N, 3). halves: (N,) each, what its outline extends to the right and up. area: (N,) of it.
    """
    scale = np.sqrt(area / (4 * halves[0] * halves[1] + SMALL))
    sides = []
    for axis, half in zip(plane, halves, strict=True):
        centre, reach = (offset * axis).sum(axis=1), half * scale
        sides.append(np.minimum(centre + reach, ratio / 2) - np.maximum(centre - reach, -ratio / 2))
    return np.asarray(np.maximum(sides[0], 0) * np.maximum(sides[1], 0))
