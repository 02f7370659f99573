# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotated surface, so that octrees of it show the same shapes at other angles to the voxels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .mesh import Material, MeshSource, TriangleBatch


def random_rotation(seed: int) -> np.ndarray:
    """Rotation (3, 3) drawn uniformly: the orthogonal factor of a Gaussian matrix, made proper."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


class RotatedSource:
    """`MeshSource` whose triangles are those of another one, rotated about the origin by a matrix (3, 3)."""

    def __init__(self, source: MeshSource, rotation: np.ndarray) -> None:
        self._source = source
        self._rotation = np.asarray(rotation, np.float64)
        self.materials: tuple[Material, ...] = source.materials
        self.triangle_count: int = source.triangle_count
        low = np.full(3, np.inf)
        high = np.full(3, -np.inf)
        for batch in self.batches():
            points = batch.corners_world.reshape(-1, 3)
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        self.bounds_world: np.ndarray = np.stack([low, high])

    def batches(self) -> Iterator[TriangleBatch]:
        """Source's batches, rotated."""
        for batch in self._source.batches():
            yield replace(batch, corners_world=batch.corners_world @ self._rotation.T)
