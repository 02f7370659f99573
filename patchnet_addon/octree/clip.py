# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact clip of triangles against the leaf grid (methods 7.2).

A triangle is peeled into slabs along x, each slab into columns along y, each column into cells along z. Pieces share their cut
vertices and the cut coordinate is set to the plane exactly, so the pieces partition the triangle and the work is linear in their number.
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
def _grow(keys, triangle, barycentric, area):  # type: ignore[no-untyped-def]
    size = len(keys)
    new_keys = np.empty(2 * size, np.uint64)
    new_triangle = np.empty(2 * size, np.int32)
    new_barycentric = np.empty((2 * size, 2), np.float32)
    new_area = np.empty(2 * size, np.float64)
    new_keys[:size] = keys
    new_triangle[:size] = triangle
    new_barycentric[:size] = barycentric
    new_area[:size] = area
    return new_keys, new_triangle, new_barycentric, new_area


@device
def clip_triangles(corners_voxel, areas_world, first, last, x_first, x_last, resolution):  # type: ignore[no-untyped-def]
    """Fragments of triangles first..last-1 in the slabs x_first..x_last-1 of the grid.

    corners_voxel: (T, 3, 3) float64, leaf cells as unit. areas_world: (T,) float64, the triangles' areas.
    Returns keys (F,) uint64, triangle (F,) int32, barycentric (F, 2) float32, area_world (F,) float64.
    Runs on one core without the interpreter lock, so several may run in threads.
    """
    keys = np.empty(_INITIAL_CAPACITY, np.uint64)
    triangle = np.empty(_INITIAL_CAPACITY, np.int32)
    barycentric = np.empty((_INITIAL_CAPACITY, 2), np.float32)
    area_world = np.empty(_INITIAL_CAPACITY, np.float64)
    count = 0
    rest_x = np.empty((2, _MAX_VERTICES, 5), np.float64)
    rest_y = np.empty((2, _MAX_VERTICES, 5), np.float64)
    rest_z = np.empty((2, _MAX_VERTICES, 5), np.float64)
    slab = np.empty((_MAX_VERTICES, 5), np.float64)
    column = np.empty((_MAX_VERTICES, 5), np.float64)
    piece = np.empty((_MAX_VERTICES, 5), np.float64)
    for t in range(first, last):
        if not areas_world[t] > 0.0:
            continue
        for corner in range(3):
            for axis in range(3):
                rest_x[0, corner, axis] = corners_voxel[t, corner, axis]
            rest_x[0, corner, 3] = 1.0 if corner == 1 else 0.0
            rest_x[0, corner, 4] = 1.0 if corner == 2 else 0.0
        n_x = 3
        now_x = 0
        x, x_end = _cell_range(rest_x[0], 3, 0, resolution)
        while x <= x_end and n_x >= 3:
            if x == x_end:
                n_slab = n_x
                slab[:n_x] = rest_x[now_x, :n_x]
                n_x = 0
            else:
                n_slab, n_x = _split(rest_x[now_x], n_x, 0, x + 1.0, slab, rest_x[1 - now_x])
                now_x = 1 - now_x
            if n_slab >= 3 and x_first <= x < x_last:
                rest_y[0, :n_slab] = slab[:n_slab]
                n_y = n_slab
                now_y = 0
                y, y_end = _cell_range(slab, n_slab, 1, resolution)
                while y <= y_end and n_y >= 3:
                    if y == y_end:
                        n_column = n_y
                        column[:n_y] = rest_y[now_y, :n_y]
                        n_y = 0
                    else:
                        n_column, n_y = _split(rest_y[now_y], n_y, 1, y + 1.0, column, rest_y[1 - now_y])
                        now_y = 1 - now_y
                    if n_column >= 3:
                        rest_z[0, :n_column] = column[:n_column]
                        n_z = n_column
                        now_z = 0
                        z, z_end = _cell_range(column, n_column, 2, resolution)
                        while z <= z_end and n_z >= 3:
                            if z == z_end:
                                n_piece = n_z
                                piece[:n_z] = rest_z[now_z, :n_z]
                                n_z = 0
                            else:
                                n_piece, n_z = _split(rest_z[now_z], n_z, 2, z + 1.0, piece, rest_z[1 - now_z])
                                now_z = 1 - now_z
                            if n_piece >= 3:
                                area, u, v = _moments(piece, n_piece)
                                if area > 0.0:
                                    if count == len(keys):
                                        keys, triangle, barycentric, area_world = _grow(
                                            keys, triangle, barycentric, area_world
                                        )
                                    keys[count] = cell_key(x, y, z)
                                    triangle[count] = t
                                    barycentric[count, 0] = u
                                    barycentric[count, 1] = v
                                    area_world[count] = 2.0 * area * areas_world[t]
                                    count += 1
                            z += 1
                    y += 1
            x += 1
    return keys[:count].copy(), triangle[:count].copy(), barycentric[:count].copy(), area_world[:count].copy()
