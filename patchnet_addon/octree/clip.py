# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact clip of triangles against the leaf grid (methods 7.2).

A triangle is peeled into slabs along x, each slab into columns along y, each column into cells along z. Pieces share
their cut vertices and the cut coordinate is set to the plane exactly, so the pieces partition the triangle and the work
is linear in their number.
"""

from __future__ import annotations

import numpy as np

from ..kernels import device, serial_kernel

# A triangle cut by six planes has at most nine vertices.
_MAX_VERTICES = 12
_INITIAL_CAPACITY = 4096


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


@device
def _copy(source, count, first, target):  # type: ignore[no-untyped-def]
    """Copy the coordinates first.. of a polygon's vertices; element by element, because slices cost more than that."""
    for i in range(count):
        for k in range(first, 5):
            target[i, k] = source[i, k]


@device
def _split(source, count, axis, plane, below, above):  # type: ignore[no-untyped-def]
    """Cut a convex polygon (rows x, y, z, u, v) at coordinate[axis] = plane; returns the two vertex counts.

    Coordinates before `axis` are left out: the axes are cut in order, so nothing looks at them again.
    """
    n_below = 0
    n_above = 0
    j = count - 1
    b = source[j, axis]
    for i in range(count):
        a = source[i, axis]
        if (a < plane and b > plane) or (a > plane and b < plane):
            # From the vertex below to the one above, so that the cut does not depend on the direction of the edge.
            low, high = (i, j) if a < b else (j, i)
            t = (plane - source[low, axis]) / (source[high, axis] - source[low, axis])
            below[n_below, axis] = plane
            above[n_above, axis] = plane
            for k in range(axis + 1, 5):
                value = source[low, k] + t * (source[high, k] - source[low, k])
                below[n_below, k] = value
                above[n_above, k] = value
            n_below += 1
            n_above += 1
        if a <= plane:
            for k in range(axis, 5):
                below[n_below, k] = source[i, k]
            n_below += 1
        if a >= plane:
            for k in range(axis, 5):
                above[n_above, k] = source[i, k]
            n_above += 1
        j = i
        b = a
    return n_below, n_above


@device
def _cell_range(polygon, count, axis, resolution):  # type: ignore[no-untyped-def]
    """First and last cell that the polygon reaches along an axis, clamped to the grid."""
    low = polygon[0, axis]
    high = low
    for i in range(1, count):
        value = polygon[i, axis]
        low = min(low, value)
        high = max(high, value)
    first = min(max(int(np.floor(low)), 0), resolution - 1)
    last = min(max(int(np.floor(high)), 0), resolution - 1)
    return first, last


@device
def _moments(polygon, count):  # type: ignore[no-untyped-def]
    """Area in (u, v) and centroid (u, v) of a polygon; the fan starts at vertex 0."""
    u0 = polygon[0, 3]
    v0 = polygon[0, 4]
    area = 0.0
    u_sum = 0.0
    v_sum = 0.0
    ua = polygon[1, 3] - u0
    va = polygon[1, 4] - v0
    for i in range(2, count):
        ub = polygon[i, 3] - u0
        vb = polygon[i, 4] - v0
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
def _reserve(cells, measures, count):  # type: ignore[no-untyped-def]
    """Room for one more fragment; the arrays double when they are full."""
    if count < len(cells):
        return cells, measures
    more_cells = np.empty((2 * count, 2), np.uint64)
    more_measures = np.empty((2 * count, 3), np.float64)
    more_cells[:count] = cells
    more_measures[:count] = measures
    return more_cells, more_measures


@device
def _put(cells, measures, count, key, triangle, area, u, v):  # type: ignore[no-untyped-def]
    """Append one fragment."""
    cells, measures = _reserve(cells, measures, count)
    cells[count, 0] = key
    cells[count, 1] = triangle
    measures[count, 0] = area
    measures[count, 1] = u
    measures[count, 2] = v
    return cells, measures


@device
def _peel(rest, now, count, axis, cell, last, slab):  # type: ignore[no-untyped-def]
    """Take the part of the polygon rest[now] in slab `cell`; the remainder lands in the other half of `rest`.

    Returns the slab's vertex count, which half holds the remainder, and the remainder's vertex count.
    """
    if cell == last:
        _copy(rest[now], count, axis, slab)
        return count, now, 0
    n_slab, n_rest = _split(rest[now], count, axis, cell + 1.0, slab, rest[1 - now])
    return n_slab, 1 - now, n_rest


@device
def _clip_column(column, n_column, key, triangle, resolution, wanted, shift, rest, piece, cells, measures, count):  # type: ignore[no-untyped-def]
    """Append the cells of one column along z to the fragments; `key` is that of the column's cell z = 0."""
    now = 0
    n_rest = n_column
    z, last = _cell_range(column, n_column, 2, resolution)
    _copy(column, n_column, 2, rest[0])
    while z <= last and n_rest >= 3:
        n_piece, now, n_rest = _peel(rest, now, n_rest, 2, z, last, piece)
        cell = key | (_spread_bits(z) << np.uint64(2))
        if n_piece >= 3 and wanted[cell >> shift]:
            area, u, v = _moments(piece, n_piece)
            if area > 0.0:
                cells, measures = _put(cells, measures, count, cell, triangle, area, u, v)
                count += 1
        z += 1
    return cells, measures, count


@device
def _clip_slab(slab, n_slab, x, triangle, resolution, wanted, shift, rest, column, piece, cells, measures, count):  # type: ignore[no-untyped-def]
    """Append the cells of one slab to the fragments, column by column along y. rest: (2, 2, vertices, 5)."""
    now = 0
    n_rest = n_slab
    y, last = _cell_range(slab, n_slab, 1, resolution)
    _copy(slab, n_slab, 1, rest[0, 0])
    while y <= last and n_rest >= 3:
        n_column, now, n_rest = _peel(rest[0], now, n_rest, 1, y, last, column)
        if n_column >= 3:
            cells, measures, count = _clip_column(
                column, n_column, cell_key(x, y, 0), triangle, resolution, wanted, shift, rest[1], piece,
                cells, measures, count,
            )  # fmt: skip
        y += 1
    return cells, measures, count


@device
def _load(corners, polygon):  # type: ignore[no-untyped-def]
    """The triangle (3, 3) as a polygon with coordinates (u, v) on the triangle."""
    for corner in range(3):
        for axis in range(3):
            polygon[corner, axis] = corners[corner, axis]
        polygon[corner, 3] = 1.0 if corner == 1 else 0.0
        polygon[corner, 4] = 1.0 if corner == 2 else 0.0


@serial_kernel
def clip_triangles(corners_voxel, areas_world, first, last, x_first, x_last, resolution, wanted, shift):  # type: ignore[no-untyped-def]
    """Fragments of triangles first..last-1 in the slabs x_first..x_last-1 of the grid.

    corners_voxel: (T, 3, 3) float64, leaf cells as unit. areas_world: (T,) float64, the triangles' areas.
    wanted: (blocks,) bool, and only fragments with wanted[key >> shift] are made; shift: uint64.
    Returns keys (F,) uint64, triangle (F,) int32, barycentric (F, 2) float32, area_world (F,) float64. A fragment
    depends on its triangle and cell alone, not on the ranges.
    Runs on one core without the interpreter lock, so several may run in threads.
    """
    cells = np.empty((_INITIAL_CAPACITY, 2), np.uint64)  # key, triangle
    measures = np.empty((_INITIAL_CAPACITY, 3), np.float64)  # area in (u, v), u, v
    count = 0
    rest = np.empty((3, 2, _MAX_VERTICES, 5), np.float64)
    slab = np.empty((_MAX_VERTICES, 5), np.float64)
    column = np.empty((_MAX_VERTICES, 5), np.float64)
    piece = np.empty((_MAX_VERTICES, 5), np.float64)
    for triangle in range(first, last):
        if not areas_world[triangle] > 0.0:
            continue
        _load(corners_voxel[triangle], rest[0, 0])
        x, x_end = _cell_range(rest[0, 0], 3, 0, resolution)
        y, y_end = _cell_range(rest[0, 0], 3, 1, resolution)
        z, z_end = _cell_range(rest[0, 0], 3, 2, resolution)
        low = cell_key(x, y, z) >> shift
        high = cell_key(x_end, y_end, z_end) >> shift
        if low == high and not wanted[low]:
            continue
        if x == x_end and y == y_end and z == z_end:
            if x_first <= x < x_last:
                cells, measures = _put(cells, measures, count, cell_key(x, y, z), triangle, 0.5, 1.0 / 3.0, 1.0 / 3.0)
                count += 1
            continue
        now = 0
        n_rest = 3
        while x <= x_end and n_rest >= 3:
            n_slab, now, n_rest = _peel(rest[0], now, n_rest, 0, x, x_end, slab)
            if n_slab >= 3 and x_first <= x < x_last:
                cells, measures, count = _clip_slab(
                    slab, n_slab, x, triangle, resolution, wanted, shift, rest[1:], column, piece,
                    cells, measures, count,
                )  # fmt: skip
            x += 1
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
    return keys, triangles, barycentric, area_world
