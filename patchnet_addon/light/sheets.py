# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets of a surface: connected triangles of one winding, and their volume and solid angles (methods 7.2f)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import kernel
from ..surface.mesh import TriangleBatch


def connected(pairs: np.ndarray, count: int) -> np.ndarray:
    """Smallest member of the connected component of each of `count` items; those of a pair (N, 2) are connected."""
    root = np.arange(count)
    while len(pairs):
        pairs = root[pairs]
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        np.minimum.at(root, pairs.max(axis=1), pairs.min(axis=1))
        while (root[root] != root).any():
            root = root[root]
    return root


def sheets_of(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T,) int32, number of each triangle's sheet, and (S,) bool, whether the sheet is open: it has a boundary.

    vertices: (V, 3), equal positions count as one, so that seams of UV maps divide no sheet. triangles: (T, 3) int32.
    Two triangles belong to one sheet if they alone share an edge, with opposite directions along it; an edge of three
    triangles, or of two with equal directions, is a boundary. So normals of a sheet are flipped together or not at all.
    Triangles of zero area belong to none, -1.
    """
    _, place = np.unique(np.ascontiguousarray(vertices).view([("", vertices.dtype)] * 3).ravel(), return_inverse=True)
    corners = place.reshape(-1)[triangles].astype(np.int64)  # (T, 3)
    distinct = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    start, end = corners[distinct].ravel(), np.roll(corners[distinct], -1, axis=1).ravel()
    key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    edges, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    turns = np.bincount(edge, np.where(start < end, 1.0, -1.0), len(edges))
    matched = ((uses == 2) & (turns == 0.0))[edge]
    inner = np.flatnonzero(matched)
    inner = inner[np.argsort(edge[inner], kind="stable")]
    root = connected((inner // 3).reshape(-1, 2), len(start) // 3)  # both triangles of each edge
    roots, number = np.unique(root, return_inverse=True)
    result = np.full(len(triangles), -1, np.int32)
    result[distinct] = number.reshape(-1)
    is_open = np.zeros(len(roots), bool)
    is_open[number.reshape(-1)[~matched.reshape(-1, 3).all(axis=1)]] = True
    return result, is_open


class Sheets(NamedTuple):
    """Sheets of T placed triangles.

    sheet: (T,) int32, number of a triangle's sheet, -1 for none. lit: (T,) int8, lit sides: the front or the back of
    closed sheets, both of open ones, and of closed ones that cameras see from within and from outside. face: (T,) uint8
    face that the front points to most (`surface/sides.py`).
    """

    sheet: np.ndarray
    lit: np.ndarray
    face: np.ndarray

    def of(self, batch: TriangleBatch) -> Sheets:
        """Sheets of the triangles of a batch."""
        return Sheets(*(column[batch.first_triangle : batch.first_triangle + len(batch)] for column in self))


@kernel
def add_volumes(corners_world, sheet, origin, volumes):
    """Add to `volumes` (S,) six times the signed volume between an origin (3,) and the triangles (T, 3, 3) of each
    sheet (T,): positive for closed sheets whose normals point outwards.
    """
    for t in range(len(sheet)):
        if sheet[t] < 0:
            continue
        ax, ay, az = corners_world[t, 0] - origin
        bx, by, bz = corners_world[t, 1] - origin
        cx, cy, cz = corners_world[t, 2] - origin
        volumes[sheet[t]] += ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@kernel
def add_solid_angles(corners_world, sheet, eyes, within, angles):
    """Add the solid angles of triangles (T, 3, 3) as seen from eyes (E, 3) to `angles` (S, E), by sheet (T,).

    within: (S, E) bool, pairs to compute. 4 pi in sum: the eye is inside a closed sheet; 0: outside. Van Oosterom and
    Strackee, The Solid Angle of a Plane Triangle, 1983.
    """
    for t in range(len(sheet)):
        for e in range(len(eyes)):
            if sheet[t] < 0 or not within[sheet[t], e]:
                continue
            ax, ay, az = corners_world[t, 0] - eyes[e]
            bx, by, bz = corners_world[t, 1] - eyes[e]
            cx, cy, cz = corners_world[t, 2] - eyes[e]
            a = np.sqrt(ax * ax + ay * ay + az * az)
            b = np.sqrt(bx * bx + by * by + bz * bz)
            c = np.sqrt(cx * cx + cy * cy + cz * cz)
            volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            ab, ac, bc = ax * bx + ay * by + az * bz, ax * cx + ay * cy + az * cz, bx * cx + by * cy + bz * cz
            angles[sheet[t], e] += 2.0 * np.arctan2(volume, a * b * c + ab * c + ac * b + bc * a)
