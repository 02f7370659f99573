# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact clip of triangles against a grid (methods 7.2).

A triangle is peeled into slabs along x, each slab into columns along y, each column into cells along z. Pieces share
their cut vertices and the cut coordinate is set to the plane exactly, so the pieces partition the triangle and the work
is linear in their number. A triangle that spans several bricks of cells is first peeled into bricks in the same way,
always at the same planes, so that unwanted bricks cost next to nothing and do not affect the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.leaf_box_kernels import packed_axis
from ..cells.morton_kernels import cell_key
from ..runtime.kernels import device, kernel
from ..surface.polygon import (
    COLUMNS,
    POLYGON_ROWS,
    U,
    V,
    X,
    Y,
    Z,
    cell_range,
    load_triangle,
    moments,
    split_x,
    split_y,
    split_z,
    splitter,
)

BRICK_LEVELS = 5  # a brick has 32 cells along each axis
_BRICK = 1 << BRICK_LEVELS
_INITIAL_CAPACITY = 4096
# The first row of each polygon, the triangle's first; "rest" is the remainder of peeling. The frame is the triangle's
# first corner and the two edges from there, since peeling overwrites the triangle.
(
    _TRIANGLE, _BRICKS_REST_X, _BRICKS_SLAB, _BRICKS_REST_Y, _BRICKS_COLUMN, _BRICKS_REST_Z, _PIECE,
    _REST_X, _SLAB, _REST_Y, _COLUMN, _REST_Z, _CELL, _FRAME, _ROWS,
) = range(0, 15 * POLYGON_ROWS, POLYGON_ROWS)  # fmt: skip

# A fragment: key of its cell, triangle, packed box, and area and centroid in (u, v).
_FRAGMENT = np.dtype([("key", "u8"), ("triangle", "i4"), ("box", "u4"), ("area", "f8"), ("u", "f8"), ("v", "f8")])

_split_bricks_x, _split_bricks_y, _split_bricks_z = (splitter(axis, 0) for axis in (X, Y, Z))


class _Brick(NamedTuple):
    """Brick of `side` cells along each axis, from the cell (x, y, z) on."""

    x: int
    y: int
    z: int
    side: int


class _Wanted(NamedTuple):
    """Requested fragments: of a triangle, in cells x_first..x_end-1 along x.

    last: the grid's last cell along an axis. near, block: see `clip_triangles`.
    """

    triangle: int
    x_first: int
    x_end: int
    last: int
    near: tuple[np.ndarray, np.uint64]
    block: tuple[np.ndarray, np.uint64]


@device
def _put(sink, count, key, triangle, box, moments):
    """Write one fragment if there is room for it, and count it."""
    if count < len(sink):
        made = sink[count]
        made.key, made.triangle, made.box = key, triangle, box
        made.area, made.u, made.v = moments
    return count + 1


@device
def _set_frame(rows):
    """Write the first corner and the edges of the triangle at row 0 to the frame."""
    for axis in range(3):
        rows[_FRAME, axis] = rows[_TRIANGLE, axis]
        for edge in range(1, 3):
            rows[_FRAME + edge, axis] = rows[_TRIANGLE + edge, axis] - rows[_TRIANGLE, axis]


@device
def _box(rows, piece, n_piece, cell):
    """Packed box around a piece of the triangle in its cell, from the vertices' weights: peeling drops x and y."""
    box = np.uint64(0)
    for axis in range(3):
        low, high = np.inf, -np.inf
        for i in range(piece, piece + n_piece):
            along = rows[i, U] * rows[_FRAME + 1, axis] + rows[i, V] * rows[_FRAME + 2, axis]
            low, high = min(low, along), max(high, along)
        start = rows[_FRAME, axis] - cell[axis]
        box |= packed_axis(axis, start + low, start + high)
    return box


# Peels within `brick`; the block of `wanted` marks the wanted cells, by their key. They append to `sink` and return the
# number of fragments.


@device
def _clip_column(rows, column, n_column, place, brick, wanted, sink, count):
    """Append the cells of one column along z at the `place` (x, y)."""
    triangle = wanted.triangle
    key = cell_key(place[0], place[1], 0)
    cells, shift = wanted.block
    rest, free, n_rest = column, _REST_Z, n_column
    z, last = cell_range(rows, column, n_column, Z, brick.z, brick.z + brick.side - 1)
    while z <= last and n_rest >= 3:
        if z == last:
            piece, n_piece, n_rest = rest, n_rest, 0
        else:
            piece = _CELL
            n_piece, n_rest = split_z(rows, rest, n_rest, z + 1.0, piece, free)
            rest, free = free, rest
        cell = key | cell_key(0, 0, z)
        if n_piece >= 3 and cells[cell >> shift]:
            found = moments(rows, piece, n_piece)
            if found[0] > 0.0:
                box = _box(rows, piece, n_piece, (place[0], place[1], z))
                count = _put(sink, count, cell, triangle, box, found)
        z += 1
    return count


@device
def _clip_slab(rows, slab, n_slab, x, brick, wanted, sink, count):
    """Append the cells of one slab, column by column along y."""
    rest, free, n_rest = slab, _REST_Y, n_slab
    y, last = cell_range(rows, slab, n_slab, Y, brick.y, brick.y + brick.side - 1)
    while y <= last and n_rest >= 3:
        if y == last:
            column, n_column, n_rest = rest, n_rest, 0
        else:
            column = _COLUMN
            n_column, n_rest = split_y(rows, rest, n_rest, y + 1.0, column, free)
            rest, free = free, rest
        if n_column >= 3:
            count = _clip_column(rows, column, n_column, (x, y), brick, wanted, sink, count)
        y += 1
    return count


@device
def _clip_piece(rows, piece, n_piece, brick, wanted, sink, count):
    """Append the fragments of a polygon within a brick, slab by slab along x."""
    rest, free, n_rest = piece, _REST_X, n_piece
    x, last = cell_range(rows, piece, n_piece, X, brick.x, brick.x + brick.side - 1)
    while x <= last and n_rest >= 3:
        if x == last:
            slab, n_slab, n_rest = rest, n_rest, 0
        else:
            slab = _SLAB
            n_slab, n_rest = split_x(rows, rest, n_rest, x + 1.0, slab, free)
            rest, free = free, rest
        if n_slab >= 3 and wanted.x_first <= x < wanted.x_end:
            count = _clip_slab(rows, slab, n_slab, x, brick, wanted, sink, count)
        x += 1
    return count


# The same peels, brick by brick; `near` of `wanted` marks bricks with any wanted cell, by the brick's key.


@device
def _bricks_of_column(rows, column, n_column, x, y, wanted, sink, count):
    """Append the fragments in one column of bricks."""
    bricks, shift = wanted.near
    rest, free, n_rest = column, _BRICKS_REST_Z, n_column
    z, last = cell_range(rows, column, n_column, Z, 0, wanted.last)
    z, last = z >> BRICK_LEVELS, last >> BRICK_LEVELS
    while z <= last and n_rest >= 3:
        if z == last:
            piece, n_piece, n_rest = rest, n_rest, 0
        else:
            piece = _PIECE
            n_piece, n_rest = _split_bricks_z(rows, rest, n_rest, (z + 1.0) * _BRICK, piece, free)
            rest, free = free, rest
        if n_piece >= 3 and bricks[cell_key(x, y, z) >> shift]:
            brick = _Brick(x * _BRICK, y * _BRICK, z * _BRICK, _BRICK)
            count = _clip_piece(rows, piece, n_piece, brick, wanted, sink, count)
        z += 1
    return count


@device
def _bricks_of_slab(rows, slab, n_slab, x, wanted, sink, count):
    """Append the fragments in one slab of bricks, column by column."""
    rest, free, n_rest = slab, _BRICKS_REST_Y, n_slab
    y, last = cell_range(rows, slab, n_slab, Y, 0, wanted.last)
    y, last = y >> BRICK_LEVELS, last >> BRICK_LEVELS
    while y <= last and n_rest >= 3:
        if y == last:
            column, n_column, n_rest = rest, n_rest, 0
        else:
            column = _BRICKS_COLUMN
            n_column, n_rest = _split_bricks_y(rows, rest, n_rest, (y + 1.0) * _BRICK, column, free)
            rest, free = free, rest
        if n_column >= 3:
            count = _bricks_of_column(rows, column, n_column, x, y, wanted, sink, count)
        y += 1
    return count


@device
def _clip_bricks(rows, x, last, wanted, sink, count):
    """Append the fragments of the triangle in `rows`, which spans the bricks x..last along x."""
    rest, free, n_rest = _TRIANGLE, _BRICKS_REST_X, 3
    while x <= last and n_rest >= 3:
        if x == last:
            slab, n_slab, n_rest = rest, n_rest, 0
        else:
            slab = _BRICKS_SLAB
            n_slab, n_rest = _split_bricks_x(rows, rest, n_rest, (x + 1.0) * _BRICK, slab, free)
            rest, free = free, rest
        if n_slab >= 3 and wanted.x_first < (x + 1) * _BRICK and x * _BRICK < wanted.x_end:
            count = _bricks_of_slab(rows, slab, n_slab, x, wanted, sink, count)
        x += 1
    return count


@device
def _clip_triangle(rows, wanted, sink, count):
    """Append the fragments of the triangle in `rows`."""
    last = wanted.last
    x, x_last = cell_range(rows, _TRIANGLE, 3, X, 0, last)
    y, y_last = cell_range(rows, _TRIANGLE, 3, Y, 0, last)
    z, z_last = cell_range(rows, _TRIANGLE, 3, Z, 0, last)
    i, j, k = x >> BRICK_LEVELS, y >> BRICK_LEVELS, z >> BRICK_LEVELS
    if i != x_last >> BRICK_LEVELS or j != y_last >> BRICK_LEVELS or k != z_last >> BRICK_LEVELS:
        return _clip_bricks(rows, i, x_last >> BRICK_LEVELS, wanted, sink, count)
    bricks, shift = wanted.near
    if not bricks[cell_key(i, j, k) >> shift]:
        return count
    if x == x_last and y == y_last and z == z_last:
        key = cell_key(x, y, z)
        third = 1.0 / 3.0
        cells, shift = wanted.block
        if cells[key >> shift] and wanted.x_first <= x < wanted.x_end:
            box = _box(rows, _TRIANGLE, 3, (x, y, z))
            return _put(sink, count, key, wanted.triangle, box, (0.5, third, third))
        return count
    brick = _Brick(i * _BRICK, j * _BRICK, k * _BRICK, min(_BRICK, last + 1))
    return _clip_piece(rows, _TRIANGLE, 3, brick, wanted, sink, count)


@kernel
def clip_triangles(
    corners_voxel: np.ndarray, areas_world: np.ndarray, first: int, last: int, slabs: tuple[int, int], resolution: int,
    near: tuple[np.ndarray, np.uint64], block: tuple[np.ndarray, np.uint64],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Fragments of triangles first..last-1 in the slabs slabs[0]..slabs[1]-1 of cells along x.

    corners_voxel: (T, 3, 3) float64, cells as unit. areas_world: (T,) float64, the triangles' areas.
    near, block: (wanted, shift) each, wanted (n,) bool by the key of a brick or cell >> shift (uint64): only fragments
    in wanted bricks and cells are made.
    Returns the fields of `Fragments`: keys (F,) uint64, triangle (F,) int32, barycentric (F, 2) float32,
    area_world (F,) float64, their origin: the keys again and `corners_voxel`, and their packed boxes (F,) uint32. A
    fragment depends only on its triangle and cell, not on other requested ones. Runs on one core without the
    interpreter lock, so several may run in threads.
    """
    made = np.empty(_INITIAL_CAPACITY, _FRAGMENT)
    rows = np.empty((_ROWS, COLUMNS), np.float64)
    count = 0
    triangle = first
    while triangle < last:
        total = count
        if areas_world[triangle] > 0.0:
            load_triangle(corners_voxel, triangle, rows)
            _set_frame(rows)
            wanted = _Wanted(triangle, slabs[0], slabs[1], resolution - 1, near, block)
            total = _clip_triangle(rows, wanted, made, count)
        if total > len(made):  # too many for the buffer: this triangle again
            more = np.empty(2 * total, _FRAGMENT)
            for row in range(count):  # one assignment would add five seconds of compilation for its shape check
                more[row] = made[row]
            made = more
            continue
        count = total
        triangle += 1
    keys = np.empty(count, np.uint64)
    triangles = np.empty(count, np.int32)
    barycentric = np.empty((count, 2), np.float32)
    area_world = np.empty(count, np.float64)
    boxes = np.empty(count, np.uint32)
    for i in range(count):
        keys[i], triangles[i], boxes[i] = made[i].key, made[i].triangle, made[i].box
        barycentric[i, 0], barycentric[i, 1] = made[i].u, made[i].v
        area_world[i] = 2.0 * made[i].area * areas_world[triangles[i]]
    return keys, triangles, barycentric, area_world, keys, corners_voxel, boxes
