# SPDX-License-Identifier: GPL-3.0-or-later
"""Bisected surface, cut open so that one can look into it: triangles beyond a plane across an axis are left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .mesh import Material, MeshSource, TriangleBatch

AXES = ("x", "y", "z")


class BisectedSource:
    """`MeshSource` of those triangles of another one whose centres lie below a plane across an axis.

    axis: 0, 1 or 2. share: where the plane lies between the lowest and the highest corner of the whole surface, 0 to 1.
    Triangles beyond it shrink to their centres and so have no area: light that was baked finds the others by number.
    Bounds stay those of the whole surface.
    """

    def __init__(self, source: MeshSource, axis: int, share: float) -> None:
        self._source = source
        self._axis = axis
        low, high = source.bounds_world[:, axis]
        self._plane_world = float(low + share * (high - low))
        self.materials: tuple[Material, ...] = source.materials
        self.triangle_count: int = source.triangle_count
        self.bounds_world: np.ndarray = source.bounds_world

    def batches(self) -> Iterator[TriangleBatch]:
        """Source's batches, with the triangles beyond the plane as points."""
        for batch in self._source.batches():
            centres = batch.corners_world.mean(axis=1, keepdims=True)  # (T, 1, 3)
            beyond = centres[:, :, self._axis : self._axis + 1] > self._plane_world
            yield replace(batch, corners_world=np.where(beyond, centres, batch.corners_world))
