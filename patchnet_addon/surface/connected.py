# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected pieces of a mesh whose vertices are welded by their place: closed ones, and sheets (methods 7.2f)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import kernel


class WeldedEdges(NamedTuple):
    """Edges of D triangles that have an area, of a mesh of T.

    distinct: (T,) bool, the triangles that are left: their corners lie at three places. corners: (D, 3) int64, numbers
    of places. edge: (D, 3) int64, number of the edge from each corner to the next, the same in all triangles at it.
    matched: (D, 3) bool, just one other triangle has that edge, and runs along it the other way.
    place_count: number of places.
    """

    distinct: np.ndarray
    corners: np.ndarray
    edge: np.ndarray
    matched: np.ndarray
    place_count: int


def welded_edges(vertices: np.ndarray, triangles: np.ndarray) -> WeldedEdges:
    """Edges of triangles (T, 3) int32 on vertices (V, 3), of which those at the same place count as one."""
    _, inverse = np.unique(np.ascontiguousarray(vertices).view([("", vertices.dtype)] * 3).ravel(), return_inverse=True)
    welded = inverse.reshape(-1)[triangles].astype(np.int64)  # (T, 3)
    distinct = (welded != np.roll(welded, -1, axis=1)).all(axis=1)
    welded = welded[distinct]
    start, end = welded.ravel(), np.roll(welded, -1, axis=1).ravel()
    count = int(inverse.max(initial=0)) + 1
    key = np.minimum(start, end) * count + np.maximum(start, end)
    edges, edge_of, uses = np.unique(key, return_inverse=True, return_counts=True)
    edge_of = edge_of.reshape(-1)
    turns = np.bincount(edge_of, np.where(start < end, 1.0, -1.0), len(edges))
    matched = ((uses == 2) & (turns == 0.0))[edge_of].reshape(-1, 3)
    return WeldedEdges(distinct, welded, edge_of.reshape(-1, 3), matched, count)


@kernel
def connected(rows, count):  # type: ignore[no-untyped-def]
    """Smallest member of the connected component of each of `count` things, where those in a row (N, K) are connected.

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


def closed_pieces(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) int32: number of the triangle's connected piece if that is closed and consistently oriented, otherwise -1.

    vertices: (V, 3), those at the same place count as one. triangles: (T, 3) int32.
    A piece is closed if every edge in it belongs to two triangles that run along it in opposite directions.
    Triangles of zero area are left out, they are never closed. Numbers are below T.
    """
    edges = welded_edges(vertices, triangles)
    root = connected(edges.corners, edges.place_count)[edges.corners[:, 0]]
    open_pieces = np.zeros(edges.place_count, bool)
    open_pieces[root[~edges.matched.all(axis=1)]] = True
    _, number = np.unique(root, return_inverse=True)
    result = np.full(len(triangles), -1, np.int32)
    result[edges.distinct] = np.where(open_pieces[root], -1, number.reshape(-1))
    return result


def sheets_of(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T,) int32, number of the sheet of each triangle, and (S,) bool, whether that is open: it has a boundary.

    vertices: (V, 3), those at the same place count as one: seams of UV maps divide no sheet. triangles: (T, 3) int32.
    Two triangles are of one sheet if an edge is theirs alone and they run along it in opposite directions; an edge of
    three, or one that two run along the same way, is a boundary. So normals of a sheet are flipped together or not at
    all. Triangles of zero area are of none, -1.
    """
    edges = welded_edges(vertices, triangles)
    inner = np.flatnonzero(edges.matched.ravel())
    inner = inner[np.argsort(edges.edge.ravel()[inner], kind="stable")]
    root = connected((inner // 3).reshape(-1, 2), len(edges.corners))  # both triangles of each edge
    roots, number = np.unique(root, return_inverse=True)
    result = np.full(len(triangles), -1, np.int32)
    result[edges.distinct] = number.reshape(-1)
    is_open = np.zeros(len(roots), bool)
    is_open[number.reshape(-1)[~edges.matched.all(axis=1)]] = True
    return result, is_open
