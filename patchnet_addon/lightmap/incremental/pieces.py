# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of a surface, small enough to ask each as a whole whether its light can have changed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...octree.voxelize import triangle_areas_and_normals
from ...runtime.progress import Progress, Steps
from ...surface.mesh import MeshSource

_ALONG = 96  # pieces along the longest side of the surface's box
_MOST_HALVINGS = 14  # of a triangle


class Pieces(NamedTuple):
    """Pieces that cover all triangles of a surface.

    triangle: (N,) int64. centre: (N, 3) float64, and radius: (N,) float64 of a ball around each, in world units.
    normal: (N, 3) float64. area: (N,) float64.
    """

    triangle: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    normal: np.ndarray
    area: np.ndarray


def pieces_of(source: MeshSource) -> Steps[Pieces]:
    """Halve large triangles across their longest edge until they are small; small ones are one piece each."""
    spacing = float(np.ptp(source.bounds_world, axis=0).max()) / _ALONG
    parts: list[Pieces] = []
    for batch in source.batches():
        parts += _halved(batch.corners_world, np.arange(len(batch)) + batch.first_triangle, spacing)
        yield Progress(batch.first_triangle + len(batch), source.triangle_count, "Following light")
    return Pieces(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _halved(corners: np.ndarray, triangle: np.ndarray, spacing: float) -> list[Pieces]:
    """Pieces of triangles (T, 3, 3), those that are halved equally often together."""
    found = []
    for halvings in range(_MOST_HALVINGS + 1):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)
        large = edges.max(axis=1) > spacing if halvings < _MOST_HALVINGS else np.zeros(len(corners), bool)
        found.append(_pieces(corners[~large], triangle[~large]))
        corners, triangle, edges = corners[large], triangle[large], edges[large]
        if not len(corners):
            break
        n, first = np.arange(len(corners)), edges.argmax(axis=1)
        start, end, other = (corners[n, (first + shift) % 3] for shift in range(3))
        middle = (start + end) / 2.0
        corners = np.concatenate([np.stack([start, middle, other], 1), np.stack([middle, end, other], 1)])
        triangle = np.tile(triangle, 2)
    return found


def _pieces(corners: np.ndarray, triangle: np.ndarray) -> Pieces:
    """Triangles (N, 3, 3) as one piece each."""
    area, normal = triangle_areas_and_normals(corners)
    centre = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centre[:, None], axis=-1).max(axis=1)
    return Pieces(triangle.astype(np.int64), centre, radius, normal, area)
