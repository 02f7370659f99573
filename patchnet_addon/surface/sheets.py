# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets of a mesh: triangles that hang together by edges, wound alike, so that they have one front (methods 7.2f)."""

from __future__ import annotations

import numpy as np

from .connected import connected, welded_edges


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
