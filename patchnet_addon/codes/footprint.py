# SPDX-License-Identifier: GPL-3.0-or-later
"""Footprint of a pixel on the cells in and around a voxel: how much of it each covers, were it alone (methods 11.2).

Cells are drawn onto the picture plane as boxes along its axes, of the area and the proportions of their outline there;
a pixel is a square. The eight children of the voxel are seen by the faces of their own children, of which those
show that no other stands before. Around the voxel, to half its side, are 56 cells of the children's size.

Everything is in the ray frame (`ray_frame.py`). A tile has pixels as columns, and in rows what kernels read of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..network.compiled_layers import TILE
from ..network.kinds import CHILDREN, OUTER
from ..runtime.kernels import device, lean_device
from .ray_frame import CELLS, SIDE, ray_frames

ABSENT = np.float32(-1)  # the luminance of a cell that is empty

_INNER = [n for n in range(CELLS) if all(1 <= n // SIDE**axis % SIDE <= 2 for axis in range(3))]
OUTER_CELLS = np.setdiff1d(np.arange(CELLS), _INNER)  # (56,) cells of the 4x4x4 that are not in the voxel
OUTER_PLACE = np.zeros(CELLS, np.uint64)  # their rows in a tile; those of the others mean nothing
OUTER_PLACE[OUTER_CELLS] = np.arange(OUTER)
assert len(OUTER_CELLS) == OUTER

_RIGHT, _UP, _START, _WIDE, _HIGH, _HALF = 0, 3, 6, 8, 12, 16  # rows of what a frame holds
FRAME_ROWS = 17
_SMALL = 1e-9  # keeps a box that is a line from dividing by 0


class FootprintTile(NamedTuple):
    """What a tile of pixels is measured with, rows of TILE float32.

    frame: 17 rows, see `set_frame`. fine: 64 rows, luminances of the voxel's grandchildren. outer: 56 rows, those of
    the cells around it; ABSENT for empty ones.
    """

    frame: np.ndarray
    fine: np.ndarray
    outer: np.ndarray


@device
def empty_footprint_tile():
    """Tile to measure in, after `clear_tile`."""
    return FootprintTile(
        np.ones(FRAME_ROWS * TILE, np.float32),
        np.empty(CELLS * TILE, np.float32),
        np.empty(OUTER * TILE, np.float32),
    )


@lean_device
def clear_tile(tile):  # type: ignore[no-untyped-def]
    """Empty all cells of a tile, before those of its pixels are written."""
    tile.fine[:] = ABSENT
    tile.outer[:] = ABSENT


@lean_device
def set_frame(frame, axes, entry, direction, up, ratio, view, place):  # type: ignore[no-untyped-def]
    """Write how a pixel sees cells into column `place` of a tile's `frame`, and its view in the ray frame into `view`.

    axes: three, of the ray frame. entry, direction, up: (3,) as in `PatchRays`, ratio a number. view: (9 * TILE,)
    direction, entry point from -1 to 1, up. Rows of `frame`: pixels to the right and up per voxel side, where the
    voxel's lowest corner lies, half widths and half heights of faces across each axis and of an outer cell, and the
    pixel's half side.
    """
    right = (
        direction[1] * up[2] - direction[2] * up[1],
        direction[2] * up[0] - direction[0] * up[2],
        direction[0] * up[1] - direction[1] * up[0],
    )
    start_right, start_up = np.float32(0), np.float32(0)
    sum_right, sum_up, sum_along = np.float32(0), np.float32(0), np.float32(0)
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
        sum_along += along
    frame[_START * TILE + place], frame[(_START + 1) * TILE + place] = start_right, start_up
    for k in range(4):
        wide, high, area = np.float32(0.25) * sum_right, np.float32(0.25) * sum_up, np.float32(0.25) * sum_along
        if k < 3:  # a face of a grandchild
            wide = np.float32(0.125) * (sum_right - abs(frame[(_RIGHT + k) * TILE + place]))
            high = np.float32(0.125) * (sum_up - abs(frame[(_UP + k) * TILE + place]))
            area = np.float32(0.0625) * view[k * TILE + place]
        scale = np.float32(np.sqrt(area / (np.float32(4) * wide * high + np.float32(_SMALL))))
        frame[(_WIDE + k) * TILE + place], frame[(_HIGH + k) * TILE + place] = wide * scale, high * scale
    frame[_HALF * TILE + place] = np.float32(0.5) * ratio


@lean_device
def measure_tile(tile, covered, shown):  # type: ignore[no-untyped-def]
    """Write the share of each pixel that the 8 children and then the 56 outer cells cover, and their luminances.

    covered, shown: (64 * TILE,) float32, rows of children, then of outer cells.
    """
    for child in range(CHILDREN):
        at = slice(child * TILE, (child + 1) * TILE)
        _measure_child(tile, child, covered[at], shown[at])
    for cell in range(OUTER):
        number = OUTER_CELLS[cell]
        middle = _middle(number % SIDE), _middle(number // SIDE % SIDE), _middle(number // SIDE**2)
        at, there = slice((CHILDREN + cell) * TILE, (CHILDREN + cell + 1) * TILE), tile.outer[cell * TILE :]
        _measure_cell(tile.frame, middle, there, covered[at], shown[at])


@lean_device
def _middle(number):  # type: ignore[no-untyped-def]
    """Middle of outer cell 0 to 3 along an axis, in sides of the voxel, which begins at 0."""
    return np.float32(0.5) * np.float32(number) - np.float32(0.25)


@lean_device
def _measure_cell(frame, middle, luminance, covered, shown):  # type: ignore[no-untyped-def]
    x, y, z = middle
    for pixel in range(TILE):
        area = _overlap(frame, pixel, x, y, z, 3)
        half = frame[_HALF * TILE + pixel]
        there = luminance[pixel] >= 0
        covered[pixel] = area / (np.float32(4) * half * half) if there else np.float32(0)
        shown[pixel] = luminance[pixel] if there else np.float32(0)


@lean_device
def _measure_child(tile, child, covered, shown):  # type: ignore[no-untyped-def]
    frame, fine = tile.frame, tile.fine
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
            du = quarter if axis == 0 else np.float32(0)
            dv = quarter if axis == 1 else np.float32(0)
            dw = quarter if axis == 2 else np.float32(0)
            for pixel in range(TILE):
                front, back = fine[near + pixel], fine[far + pixel]
                first = _overlap(frame, pixel, u, v, w, axis)
                second = _overlap(frame, pixel, u + du, v + dv, w + dw, axis)
                light = front if front >= 0 else back
                area = (first if front >= 0 else second) if light >= 0 else np.float32(0)
                covered[pixel] += area
                shown[pixel] += area * light
    for pixel in range(TILE):
        half = frame[_HALF * TILE + pixel]
        shown[pixel] = shown[pixel] / covered[pixel] if covered[pixel] > 0 else np.float32(0)
        covered[pixel] = covered[pixel] / (np.float32(4) * half * half)


@lean_device
def _overlap(frame, pixel, x, y, z, kind):  # type: ignore[no-untyped-def]
    """Area of the pixel, in sides of the voxel squared, that a face or cell about (x, y, z) covers.

    kind: axis that the face is across, 3 for an outer cell.
    """
    right = frame[_START * TILE + pixel] + x * frame[pixel]
    right += y * frame[(_RIGHT + 1) * TILE + pixel] + z * frame[(_RIGHT + 2) * TILE + pixel]
    above = frame[(_START + 1) * TILE + pixel] + x * frame[_UP * TILE + pixel]
    above += y * frame[(_UP + 1) * TILE + pixel] + z * frame[(_UP + 2) * TILE + pixel]
    wide, high = frame[(_WIDE + kind) * TILE + pixel], frame[(_HIGH + kind) * TILE + pixel]
    half = frame[_HALF * TILE + pixel]
    across = min(right + wide, half) - max(right - wide, -half)
    up = min(above + high, half) - max(above - high, -half)
    return max(across, np.float32(0)) * max(up, np.float32(0))


def footprint_reference(
    fine: np.ndarray, outer: np.ndarray, entry: np.ndarray, direction: np.ndarray, up: np.ndarray, ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """View (N, 9), coverage (N, 64) and luminances (N, 64), float32, of children and outer cells, in NumPy.

    fine: (N, 64), outer: (N, 56) luminances in the ray frame, ABSENT for none. entry, direction, up: (N, 3) in octree
    axes. ratio: (N,).
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
            ahead = fine[:, cell - SIDE**axis] if place[axis] % 2 else np.full(len(fine), ABSENT)
            middle = (place + 0.5) / SIDE
            middle[axis] -= 0.125  # the face that the ray meets
            seen = _box_overlap(middle - point, (right, above), (wide, high), area, ratio)
            seen = np.where((fine[:, cell] >= 0) & (ahead < 0), seen, 0)
            child = (place // 2) @ np.array([1, 2, 4])
            covered[:, child] += seen
            shown[:, child] += seen * fine[:, cell]
    wide, high = (0.25 * np.abs(plane).sum(axis=1) for plane in (right, above))
    middles = np.stack([OUTER_CELLS // SIDE**k % SIDE for k in range(3)], axis=-1) / 2 - 0.25  # (56, 3)
    around = [
        _box_overlap(middle - point, (right, above), (wide, high), along.sum(axis=1) / 4, ratio) for middle in middles
    ]
    whole = np.concatenate([covered, np.where(outer >= 0, np.stack(around, axis=1), 0)], axis=1)
    light = np.divide(shown, covered, out=np.zeros_like(shown), where=covered > 0)
    lights = np.concatenate([light, np.maximum(outer, 0)], axis=1)
    view = np.concatenate([along, 2 * point - 1, above], axis=1)
    return view.astype(np.float32), (whole / ratio[:, None] ** 2).astype(np.float32), lights.astype(np.float32)


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
    scale = np.sqrt(area / (4 * halves[0] * halves[1] + _SMALL))
    sides = []
    for axis, half in zip(plane, halves, strict=True):
        centre, reach = (offset * axis).sum(axis=1), half * scale
        sides.append(np.minimum(centre + reach, ratio / 2) - np.maximum(centre - reach, -ratio / 2))
    return np.asarray(np.maximum(sides[0], 0) * np.maximum(sides[1], 0))
