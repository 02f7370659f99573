# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of a surface, small enough to ask each as a whole whether its light can have changed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...octree.voxelize import triangle_areas_and_normals
from ...runtime.progress import Progress, Steps
from ...surface.mesh import MeshSource

_ALONG = 96  # pieces along the longest side of the surface's box
_MOST_PARTS = 128  # of an edge


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
    """Divide the edges of large triangles evenly; small triangles are one piece each."""
    spacing = float(np.ptp(source.bounds_world, axis=0).max()) / _ALONG
    parts: list[Pieces] = []
    for batch in source.batches():
        parts += _divided(batch.corners_world, batch.first_triangle, spacing)
        yield Progress(batch.first_triangle + len(batch), source.triangle_count, "Following light")
    return Pieces(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _divided(corners: np.ndarray, first: int, spacing: float) -> list[Pieces]:
    """Pieces of triangles (T, 3, 3), those with equally many parts an edge together."""
    area, normal = triangle_areas_and_normals(corners)
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1).max(axis=1)
    counts = np.clip(np.ceil(longest / max(spacing, 1e-30)), 1, _MOST_PARTS).astype(int)
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=-1).max(axis=1)
    found = []
    for count in np.unique(counts).tolist():
        chosen = np.flatnonzero(counts == count)
        weights = _centroids(count)  # (count^2, 3)
        number = len(weights)
        found.append(
            Pieces(
                np.repeat(chosen + first, number),
                np.einsum("wc,tcx->twx", weights, corners[chosen]).reshape(-1, 3),
                np.repeat(radius[chosen] / count, number),
                np.repeat(normal[chosen], number, axis=0),
                np.repeat(area[chosen] / number, number),
            )
        )
    return found


def _centroids(count: int) -> np.ndarray:
    """Barycentric centroids (count^2, 3) of the parts of a triangle whose edges are divided into `count`."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    upright, turned = i + j < count, i + j < count - 1
    first = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / count
    second = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / count
    return np.stack([1.0 - first - second, first, second], axis=-1)
