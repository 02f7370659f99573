# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets of a mesh whose vertices are welded by position (methods 7.2f)."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import kernel


@kernel
def connected(rows, count):  # type: ignore[no-untyped-def]
    """Smallest member of the connected component of each of `count` items; items in a row (N, K) are connected.

    Union by index, paths halved.
    """
    parent = np.arange(count)
    for index in range(len(rows)):
        for other in range(1, rows.shape[1]):
            a = rows[index, 0]
            b = rows[index, other]
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if a < b:
                parent[b] = a
            else:
                parent[a] = b
    for member in range(count):
        root = member
        while parent[root] != root:
            root = parent[root]
        parent[member] = root
    return parent


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
