# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact clip of triangles against the leaf grid (methods 7.2).

A triangle is peeled into slabs along x, each slab into columns along y, each column into cells along z. Pieces share
their cut vertices and the cut coordinate is set to the plane exactly, so the pieces partition the triangle and the work
is linear in their number.
"""

from __future__ import annotations

import numpy as np

from ..kernels import device

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
def _split(source, count, axis, plane, below, above):  # type: ignore[no-untyped-def]
    """Cut a convex polygon (rows x, y, z, u, v) at coordinate[axis] = plane; returns the two vertex counts."""
    n_below = 0
    n_above = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        a = source[i, axis]
        b = source[j, axis]
        if a <= plane:
            below[n_below, :] = source[i, :]
            n_below += 1
        if a >= plane:
            above[n_above, :] = source[i, :]
            n_above += 1
        if (a < plane and b > plane) or (a > plane and b < plane):
            t = (plane - a) / (b - a)
            for k in range(5):
                value = source[i, k] + t * (source[j, k] - source[i, k])
                below[n_below, k] = value
                above[n_above, k] = value
            below[n_below, axis] = plane
            above[n_above, axis] = plane
            n_below += 1
            n_above += 1
    return n_below, n_above


@device
def _cell_range(polygon, count, axis, resolution):  # type: ignore[no-untyped-def]
    """First and last cell that the polygon reaches along an axis, clamped to the grid."""
    low = polygon[0, axis]
    high = low
    for i in range(1, count):
        low = min(low, polygon[i, axis])
        high = max(high, polygon[i, axis])
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
    for i in range(1, count - 1):
        ua = polygon[i, 3] - u0
        va = polygon[i, 4] - v0
        ub = polygon[i + 1, 3] - u0
        vb = polygon[i + 1, 4] - v0
        piece = 0.5 * (ua * vb - ub * va)
        area += piece
        u_sum += piece * (ua + ub)
        v_sum += piece * (va + vb)
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
def _peel(rest, now, count, axis, cell, last, slab):  # type: ignore[no-untyped-def]
    """Take the part of the polygon rest[now] in slab `cell`; the remainder lands in the other half of `rest`.

    Returns the slab's vertex count, which half holds the remainder, and the remainder's vertex count.
    """
    if cell == last:
        slab[:count] = rest[now, :count]
        return count, now, 0
    n_slab, n_rest = _split(rest[now], count, axis, cell + 1.0, slab, rest[1 - now])
    return n_slab, 1 - now, n_rest


@device
def _clip_column(column, n_column, x, y, triangle, resolution, rest, piece, cells, measures, count):  # type: ignore[no-untyped-def]
    """Append the cells of one column along z to the fragments."""
    rest[0, :n_column] = column[:n_column]
    now = 0
    n_rest = n_column
    z, last = _cell_range(column, n_column, 2, resolution)
    while z <= last and n_rest >= 3:
        n_piece, now, n_rest = _peel(rest, now, n_rest, 2, z, last, piece)
        if n_piece >= 3:
            area, u, v = _moments(piece, n_piece)
            if area > 0.0:
                cells, measures = _reserve(cells, measures, count)
                cells[count, 0] = cell_key(x, y, z)
                cells[count, 1] = triangle
                measures[count, 0] = area
                measures[count, 1] = u
                measures[count, 2] = v
                count += 1
        z += 1
    return cells, measures, count


@device
def _clip_slab(slab, n_slab, x, triangle, resolution, rest, column, piece, cells, measures, count):  # type: ignore[no-untyped-def]
    """Append the cells of one slab to the fragments, column by column along y. rest: (2, 2, vertices, 5)."""
    rest[0, 0, :n_slab] = slab[:n_slab]
    now = 0
    n_rest = n_slab
    y, last = _cell_range(slab, n_slab, 1, resolution)
    while y <= last and n_rest >= 3:
        n_column, now, n_rest = _peel(rest[0], now, n_rest, 1, y, last, column)
        if n_column >= 3:
            cells, measures, count = _clip_column(
                column, n_column, x, y, triangle, resolution, rest[1], piece, cells, measures, count
            )
        y += 1
    return cells, measures, count


@device
def clip_triangles(corners_voxel, areas_world, first, last, x_first, x_last, resolution):  # type: ignore[no-untyped-def]
    """Fragments of triangles first..last-1 in the slabs x_first..x_last-1 of the grid.

    corners_voxel: (T, 3, 3) float64, leaf cells as unit. areas_world: (T,) float64, the triangles' areas.
    Returns keys (F,) uint64, triangle (F,) int32, barycentric (F, 2) float32, area_world (F,) float64.
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
        for corner in range(3):
            for axis in range(3):
                rest[0, 0, corner, axis] = corners_voxel[triangle, corner, axis]
            rest[0, 0, corner, 3] = 1.0 if corner == 1 else 0.0
            rest[0, 0, corner, 4] = 1.0 if corner == 2 else 0.0
        now = 0
        n_rest = 3
        x, x_end = _cell_range(rest[0, 0], 3, 0, resolution)
        while x <= x_end and n_rest >= 3:
            n_slab, now, n_rest = _peel(rest[0], now, n_rest, 0, x, x_end, slab)
            if n_slab >= 3 and x_first <= x < x_last:
                cells, measures, count = _clip_slab(
                    slab, n_slab, x, triangle, resolution, rest[1:], column, piece, cells, measures, count
                )
            x += 1
    triangles = cells[:count, 1].astype(np.int32)
    area_world = 2.0 * measures[:count, 0] * areas_world[triangles]
    return cells[:count, 0].copy(), triangles, measures[:count, 1:].astype(np.float32), area_world
