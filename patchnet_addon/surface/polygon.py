# SPDX-License-Identifier: GPL-3.0-or-later
"""Convex polygons in compiled code: cuts at planes, and measures.

All polygons are in one array of vertices (x, y, z, u, v) and identified by their first row: views of arrays cost the
compiled code more than the clipping itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..runtime.kernels import device

X, Y, Z, U, V = range(5)  # columns of a vertex
COLUMNS = 5
# A triangle cut by twelve planes, six of a brick and six of a cell, has at most fifteen vertices.
POLYGON_ROWS = 16


def splitter(axis: int, kept: int) -> Callable[..., tuple[int, int]]:
    """Cut along one axis; compiled once for each, so that the loops over coordinates unroll.

    Coordinates before `kept` are omitted from the parts: with axes cut in order, they are no longer needed.
    """

    def split(rows, source, count, plane, below, above):
        """Cut the convex polygon at row `source` at coordinate[axis] = plane; returns the two vertex counts."""
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
                for k in range(kept, COLUMNS):
                    value = rows[low, k] + t * (rows[high, k] - rows[low, k])
                    rows[n_below, k] = value
                    rows[n_above, k] = value
                rows[n_below, axis] = plane
                rows[n_above, axis] = plane
                n_below += 1
                n_above += 1
            if a <= plane:
                for k in range(kept, COLUMNS):
                    rows[n_below, k] = rows[i, k]
                n_below += 1
            if a >= plane:
                for k in range(kept, COLUMNS):
                    rows[n_above, k] = rows[i, k]
                n_above += 1
            j = i
            b = a
        return n_below - below, n_above - above

    # Compiled code is linked by name. The default names contain a counter of the process, so that cached functions of
    # two processes could be confused.
    split.__name__ = split.__qualname__ = f"split_{'xyz'[axis]}_from_{kept}"
    return device(split)


split_x, split_y, split_z = (splitter(axis, axis) for axis in (X, Y, Z))


@device
def load_triangle(corners_voxel, triangle, rows):
    """Write a triangle as the polygon at row 0, with its weights of corners 1 and 2 as (u, v)."""
    for corner in range(3):
        for axis in range(3):
            rows[corner, axis] = corners_voxel[triangle, corner, axis]
        rows[corner, U] = 1.0 if corner == 1 else 0.0
        rows[corner, V] = 1.0 if corner == 2 else 0.0


@device
def polygon_bounds(rows, polygon, count, column):
    """Lowest and highest number of a polygon's vertices in one column."""
    low = rows[polygon, column]
    high = low
    for i in range(polygon + 1, polygon + count):
        low = min(low, rows[i, column])
        high = max(high, rows[i, column])
    return low, high


@device
def cell_range(rows, polygon, count, axis, first, last):
    """First and last cell that the polygon reaches along an axis, clamped to cells first..last."""
    low, high = polygon_bounds(rows, polygon, count, axis)
    return min(max(int(np.floor(low)), first), last), min(max(int(np.floor(high)), first), last)


@device
def moments(rows, polygon, count):
    """Area in (u, v) and centroid (u, v) of a polygon; the fan starts at vertex 0."""
    u0 = rows[polygon, U]
    v0 = rows[polygon, V]
    area = 0.0
    u_sum = 0.0
    v_sum = 0.0
    ua = rows[polygon + 1, U] - u0
    va = rows[polygon + 1, V] - v0
    for i in range(polygon + 2, polygon + count):
        ub = rows[i, U] - u0
        vb = rows[i, V] - v0
        piece = 0.5 * (ua * vb - ub * va)
        area += piece
        u_sum += piece * (ua + ub)
        v_sum += piece * (va + vb)
        ua = ub
        va = vb
    if area <= 0.0:
        return 0.0, 0.0, 0.0
    return area, u0 + u_sum / (3.0 * area), v0 + v_sum / (3.0 * area)
