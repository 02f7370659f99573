# SPDX-License-Identifier: GPL-3.0-or-later
"""Free space around the occupied voxels of an octree, where a camera may be."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.tracing.viewpoints import grown, occupied_cells

_LEVELS_ABOVE_LEAVES = 2  # a cell is four finest voxels wide
_MAX_LEVEL = 8  # 17 million cells


class FreeSpace:
    """Cells of a level that are neither occupied nor beside an occupied cell, and all that is outside the cube.

    So a free point is at least `clearance_world` from every occupied voxel: four finest voxels, more below depth 10.
    bounds_world: (2, 3) float64, box of the occupied cells.
    """

    def __init__(self, octree: Octree) -> None:
        self._grid = octree.grid
        self._level = min(max(octree.depth - _LEVELS_ABOVE_LEAVES, 0), _MAX_LEVEL)
        occupied = np.pad(occupied_cells(octree, self._level), 1)
        self._blocked = grown(occupied)
        self.clearance_world: float = octree.grid.side_world / (1 << self._level)
        where = np.argwhere(occupied) - 1
        corners = np.stack([where.min(axis=0), where.max(axis=0) + 1])
        self.bounds_world: np.ndarray = octree.grid.to_world(corners / (1 << self._level))

    def contains(self, points_world: np.ndarray) -> np.ndarray:
        """Tell which points (N, 3) are free: (N,) bool."""
        cells = np.floor(self._grid.to_unit(points_world) * (1 << self._level)).astype(np.int64) + 1
        inside = ((cells >= 0) & (cells < len(self._blocked))).all(axis=1)
        x, y, z = np.where(inside[:, None], cells, 0).T
        return ~(inside & self._blocked[x, y, z])

    def contains_path(self, points_world: np.ndarray) -> bool:
        """Tell whether all of a path of straight pieces between points (N, 3) is free."""
        spacing = 0.5 * self.clearance_world
        for start, end in pairwise(points_world):
            count = int(np.linalg.norm(end - start) / spacing) + 2
            if not self.contains(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)).all():
                return False
        return bool(self.contains(points_world[-1:]).all())
