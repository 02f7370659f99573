# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact clip of triangles against the leaf grid (methods 7.2).

A triangle is peeled into slabs along x, each slab into columns along y, each column into cells along z. Pieces share
their cut vertices and the cut coordinate is set to the plane exactly, so the pieces partition the triangle and the work
is linear in their number.
"""

from __future__ import annotations

import numpy as np

from ..kernels import device, serial_kernel

_INITIAL_CAPACITY = 4096
# All polygons live in one array of vertices (x, y, z, u, v) and are named by their first row: views of arrays cost the
# compiled code more than the clipping itself. A triangle cut by six planes has at most nine vertices.
_TRIANGLE, _REST_X, _SLAB, _REST_Y, _COLUMN, _REST_Z, _CELL, _ROWS = 0, 12, 24, 36, 48, 60, 72, 84


@device
def _spread_bits(value):  # type: ignore[no-untyped-def]
    bits = np.uint64(value)
    bits = (bits | (bits << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
    bits = (bits | (bits << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | (bits << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | (bits << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (bits | (bits << np.uint64(2))) & np.uint64(0x1249249249249249)


@device
def cell_key(x, y, z):  # type: ignore[no-untyped-def]
    """Morton key of one cell; the compiled twin of `grid.morton_encode`."""
    return _spread_bits(x) | (_spread_bits(y) << np.uint64(1)) | (_spread_bits(z) << np.uint64(2))


def _splitter(axis):  # type: ignore[no-untyped-def]
    """Cut along one axis; compiled once for each, so that the loops over coordinates unroll."""

    @device
    def split(rows, source, count, plane, below, above):  # type: ignore[no-untyped-def]
        """Cut the convex polygon at row `source` at coordinate[axis] = plane; returns the two vertex counts.

        Coordinates before `axis` are left out: the axes are cut in order, so nothing looks at them again.
        """
        n_below = below
        n_above = above
        j = source + count - 1
        b = rows[j, axis]
        for i in range(source, source + count):
            a = rows[i, axis]
            if (a < plane and b > plane) or (a > plane and b < plane):
                # From the vertex below to the one above, so that the cut does not depend on the direction of the edge.
                low, high = (i, j) if a < b else (j, i)
                t = (plane - rows[low, axis]) / (rows[high, axis] - rows[low, axis])
                rows[n_below, axis] = plane
                rows[n_above, axis] = plane
                for k in range(axis + 1, 5):
                    value = rows[low, k] + t * (rows[high, k] - rows[low, k])
                    rows[n_below, k] = value
                    rows[n_above, k] = value
                n_below += 1
                n_above += 1
            if a <= plane:
                for k in range(axis, 5):
                    rows[n_below, k] = rows[i, k]
                n_below += 1
            if a >= plane:
                for k in range(axis, 5):
                    rows[n_above, k] = rows[i, k]
                n_above += 1
            j = i
            b = a
        return n_below - below, n_above - above

    return split


split_x, split_y, split_z = (_splitter(axis) for axis in range(3))


@device
def _cell_range(rows, polygon, count, axis, resolution):  # type: ignore[no-untyped-def]
    """First and last cell that the polygon reaches along an axis, clamped to the grid."""
    low = rows[polygon, axis]
    high = low
    for i in range(polygon + 1, polygon + count):
        value = rows[i, axis]
        low = min(low, value)
        high = max(high, value)
    first = min(max(int(np.floor(low)), 0), resolution - 1)
    last = min(max(int(np.floor(high)), 0), resolution - 1)
    return first, last


@device
def moments(rows, polygon, count):  # type: ignore[no-untyped-def]
    """Area in (u, v) and centroid (u, v) of a polygon; the fan starts at vertex 0."""
    u0 = rows[polygon, 3]
    v0 = rows[polygon, 4]
    area = 0.0
    u_sum = 0.0
    v_sum = 0.0
    ua = rows[polygon + 1, 3] - u0
    va = rows[polygon + 1, 4] - v0
    for i in range(polygon + 2, polygon + count):
        ub = rows[i, 3] - u0
        vb = rows[i, 4] - v0
        piece = 0.5 * (ua * vb - ub * va)
        area += piece
        u_sum += piece * (ua + ub)
        v_sum += piece * (va + vb)
        ua = ub
        va = vb
    if area <= 0.0:
        return 0.0, 0.0, 0.0
    return area, u0 + u_sum / (3.0 * area), v0 + v_sum / (3.0 * area)


@device
def _put(cells, measures, count, key, triangle, area, u, v):  # type: ignore[no-untyped-def]
    """Write one fragment where there is room for it; it counts in any case."""
    if count < len(cells):
        cells[count, 0] = key
        cells[count, 1] = triangle
        measures[count, 0] = area
        measures[count, 1] = u
        measures[count, 2] = v
    return count + 1


@device
def _clip_column(rows, column, n_column, key, triangle, resolution, wanted, shift, cells, measures, count):  # type: ignore[no-untyped-def]
    """Append the cells of one column along z; `key` is that of the cell z = 0. Returns the number of fragments."""
    rest, free, n_rest = column, _REST_Z, n_column
    z, last = _cell_range(rows, column, n_column, 2, resolution)
    while z <= last and n_rest >= 3:
        if z == last:
            piece, n_piece, n_rest = rest, n_rest, 0
        else:
            piece = _CELL
            n_piece, n_rest = split_z(rows, rest, n_rest, z + 1.0, piece, free)
            rest, free = free, rest
        cell = key | (_spread_bits(z) << np.uint64(2))
        if n_piece >= 3 and wanted[cell >> shift]:
            area, u, v = moments(rows, piece, n_piece)
            if area > 0.0:
                count = _put(cells, measures, count, cell, triangle, area, u, v)
        z += 1
    return count


@device
def _clip_slab(rows, slab, n_slab, x, triangle, resolution, wanted, shift, cells, measures, count):  # type: ignore[no-untyped-def]
    """Append the cells of one slab, column by column along y. Returns the number of fragments."""
    rest, free, n_rest = slab, _REST_Y, n_slab
    y, last = _cell_range(rows, slab, n_slab, 1, resolution)
    while y <= last and n_rest >= 3:
        if y == last:
            column, n_column, n_rest = rest, n_rest, 0
        else:
            column = _COLUMN
            n_column, n_rest = split_y(rows, rest, n_rest, y + 1.0, column, free)
            rest, free = free, rest
        if n_column >= 3:
            key = cell_key(x, y, 0)
            count = _clip_column(
                rows, column, n_column, key, triangle, resolution, wanted, shift, cells, measures, count
            )
        y += 1
    return count


@device
def _clip_triangle(rows, triangle, x_first, x_last, resolution, wanted, shift, cells, measures, count):  # type: ignore[no-untyped-def]
    """Append the fragments of the triangle in `rows`, slab by slab along x. Returns the number of fragments."""
    x, x_end = _cell_range(rows, _TRIANGLE, 3, 0, resolution)
    y, y_end = _cell_range(rows, _TRIANGLE, 3, 1, resolution)
    z, z_end = _cell_range(rows, _TRIANGLE, 3, 2, resolution)
    low = cell_key(x, y, z)
    if low >> shift == cell_key(x_end, y_end, z_end) >> shift and not wanted[low >> shift]:
        return count
    if x == x_end and y == y_end and z == z_end:
        third = 1.0 / 3.0
        return _put(cells, measures, count, low, triangle, 0.5, third, third) if x_first <= x < x_last else count
    rest, free, n_rest = _TRIANGLE, _REST_X, 3
    while x <= x_end and n_rest >= 3:
        if x == x_end:
            slab, n_slab, n_rest = rest, n_rest, 0
        else:
            slab = _SLAB
            n_slab, n_rest = split_x(rows, rest, n_rest, x + 1.0, slab, free)
            rest, free = free, rest
        if n_slab >= 3 and x_first <= x < x_last:
            count = _clip_slab(rows, slab, n_slab, x, triangle, resolution, wanted, shift, cells, measures, count)
        x += 1
    return count


@device
def load_triangle(corners_voxel, triangle, rows):  # type: ignore[no-untyped-def]
    """Write a triangle as the polygon at row 0, with its weights of corners 1 and 2 as (u, v)."""
    for corner in range(3):
        for axis in range(3):
            rows[_TRIANGLE + corner, axis] = corners_voxel[triangle, corner, axis]
        rows[_TRIANGLE + corner, 3] = 1.0 if corner == 1 else 0.0
        rows[_TRIANGLE + corner, 4] = 1.0 if corner == 2 else 0.0


@serial_kernel
def clip_triangles(corners_voxel, areas_world, first, last, x_first, x_last, resolution, wanted, shift):  # type: ignore[no-untyped-def]
    """Fragments of triangles first..last-1 in the slabs x_first..x_last-1 of the grid.

    corners_voxel: (T, 3, 3) float64, leaf cells as unit. areas_world: (T,) float64, the triangles' areas.
    wanted: (blocks,) bool, and only fragments with wanted[key >> shift] are made; shift: uint64.
    Returns the fields of `Fragments`: keys (F,) uint64, triangle (F,) int32, barycentric (F, 2) float32,
    area_world (F,) float64, and what they were cut from: the keys again and `corners_voxel`. A fragment depends on its
    triangle and cell alone, not on the ranges.
    Runs on one core without the interpreter lock, so several may run in threads.
    """
    cells = np.empty((_INITIAL_CAPACITY, 2), np.uint64)  # key, triangle
    measures = np.empty((_INITIAL_CAPACITY, 3), np.float64)  # area in (u, v), u, v
    rows = np.empty((_ROWS, 5), np.float64)
    count = 0
    triangle = first
    while triangle < last:
        total = count
        if areas_world[triangle] > 0.0:
            load_triangle(corners_voxel, triangle, rows)
            total = _clip_triangle(rows, triangle, x_first, x_last, resolution, wanted, shift, cells, measures, count)
        if total > len(cells):  # too many for the room there was: this triangle once more
            more_cells = np.empty((2 * total, 2), np.uint64)
            more_measures = np.empty((2 * total, 3), np.float64)
            more_cells[:count] = cells[:count]
            more_measures[:count] = measures[:count]
            cells, measures = more_cells, more_measures
            continue
        count = total
        triangle += 1
    keys = np.empty(count, np.uint64)
    triangles = np.empty(count, np.int32)
    barycentric = np.empty((count, 2), np.float32)
    area_world = np.empty(count, np.float64)
    for i in range(count):
        keys[i] = cells[i, 0]
        triangles[i] = cells[i, 1]
        barycentric[i, 0] = measures[i, 1]
        barycentric[i, 1] = measures[i, 2]
        area_world[i] = 2.0 * measures[i, 0] * areas_world[triangles[i]]
    return keys, triangles, barycentric, area_world, keys, corners_voxel
