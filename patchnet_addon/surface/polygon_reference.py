# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of `polygon`: cutting a convex polygon at a plane, one vertex after the other."""

from __future__ import annotations


def half_space(polygon: list, axis: int, plane: float, sign: float) -> list:
    """Part of the polygon with sign * (coordinate - plane) >= 0 (Sutherland and Hodgman)."""
    kept = []
    for (a, wa), (b, wb) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        da, db = sign * (a[axis] - plane), sign * (b[axis] - plane)
        if da >= 0:
            kept.append((a, wa))
        if (da < 0 < db) or (db < 0 < da):
            t = da / (da - db)
            point = a + t * (b - a)
            point[axis] = plane
            kept.append((point, wa + t * (wb - wa)))
    return kept
