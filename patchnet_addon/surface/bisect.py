# SPDX-License-Identifier: GPL-3.0-or-later
"""Bisect a lit surface, so that one can look into it: what lies beyond a plane across an axis is left out."""

from __future__ import annotations

import numpy as np

from .mesh import Fragments, ShadingFn, TriangleBatch

AXES = ("x", "y", "z")


def bisected_shade(shade: ShadingFn, bounds_world: np.ndarray, axis: int, share: float) -> ShadingFn:
    """ShadingFn like `shade` that has no opacity where centroids of fragments lie beyond a plane: they leave no voxel.

    bounds_world: (2, 3) box of the surface. axis: 0, 1 or 2. share: where the plane lies between the box's lowest and
    highest corner, 0 to 1. The cut is as even as the leaves are small, whatever the size of triangles.
    """
    low, high = bounds_world[:, axis]
    plane_world = low + share * (high - low)

    def bisected(batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, ...]:
        luminance, opacity, *color = shade(batch, fragments)
        beyond = _centroids(batch, fragments, axis) > plane_world
        return (luminance, np.where(beyond, np.float32(0.0), opacity), *color)

    return bisected


def _centroids(batch: TriangleBatch, fragments: Fragments, axis: int) -> np.ndarray:
    """Coordinate (F,) float64 of the fragments' centroids along an axis."""
    first, second, third = batch.corners_world[fragments.triangle, :, axis].T
    u, v = fragments.barycentric.T
    return np.asarray(first + u * (second - first) + v * (third - first))
