# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed surfaces: the triangles of each, whose inner side is never seen."""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import kernel


def closed_pieces(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) int32: number of the triangle's connected piece if that is closed and consistently oriented, otherwise -1.

    vertices: (V, 3), those at the same place count as one. triangles: (T, 3) int32.
    A piece is closed if every edge in it belongs to two triangles that run along it in opposite directions.
    Triangles of zero area are left out, they are never closed. Numbers are below T.
    """
    _, inverse = np.unique(np.ascontiguousarray(vertices).view([("", vertices.dtype)] * 3).ravel(), return_inverse=True)
    welded = inverse.reshape(-1)[triangles].astype(np.int64)  # (T, 3)
    distinct = (welded != np.roll(welded, -1, axis=1)).all(axis=1)
    welded = welded[distinct]
    start, end = welded.ravel(), np.roll(welded, -1, axis=1).ravel()
    count = int(inverse.max(initial=0)) + 1
    key = np.minimum(start, end) * count + np.maximum(start, end)
    edges, edge_of, uses = np.unique(key, return_inverse=True, return_counts=True)
    turns = np.bincount(edge_of.reshape(-1), np.where(start < end, 1.0, -1.0), len(edges))
    matched = ((uses == 2) & (turns == 0.0))[edge_of.reshape(-1)].reshape(-1, 3).all(axis=1)
    root = _pieces(welded, count)[welded[:, 0]]
    open_pieces = np.zeros(count, bool)
    open_pieces[root[~matched]] = True
    _, number = np.unique(root, return_inverse=True)
    result = np.full(len(triangles), -1, np.int32)
    result[distinct] = np.where(open_pieces[root], -1, number.reshape(-1))
    return result


@kernel
def _pieces(triangles, count):  # type: ignore[no-untyped-def]
    """Smallest vertex of the connected piece of each vertex (union by index, paths halved)."""
    parent = np.arange(count)
    for index in range(len(triangles)):
        for corner in range(1, 3):
            a = triangles[index, 0]
            b = triangles[index, corner]
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
    for vertex in range(count):
        root = vertex
        while parent[root] != root:
            root = parent[root]
        parent[vertex] = root
    return parent
