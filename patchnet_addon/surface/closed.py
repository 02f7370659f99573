# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed surfaces: the triangles of each, whose inner side is never seen."""

from __future__ import annotations

import numpy as np

from .connected import connected, welded_edges


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
