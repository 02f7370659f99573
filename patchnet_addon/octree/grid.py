# SPDX-License-Identifier: GPL-3.0-or-later
"""Grid: the cube that an octree divides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.bounds import MAX_DEPTH
from ..runtime.errors import SettingError

# The cube is a little larger than the geometry, so that surfaces on its faces do not depend on rounding.
_MARGIN = 1.0 + 2.0**-16


@dataclass(frozen=True)
class Grid:
    """Cube [origin, origin + side]^3 in world units, divided 2^depth times along each axis."""

    origin_world: tuple[float, float, float]
    side_world: float
    depth: int

    def __post_init__(self) -> None:
        if not 1 <= self.depth <= MAX_DEPTH:
            raise SettingError(f"Depth {self.depth} is outside 1 to {MAX_DEPTH}: choose a depth in this range")
        if not (np.isfinite(self.side_world) and self.side_world > 0):
            raise SettingError(f"The octree's cube has side {self.side_world}: the geometry has no extent")

    @classmethod
    def around(cls, bounds_world: np.ndarray, depth: int) -> Grid:
        """Smallest cube around `bounds_world` (2, 3), centred on it, with a margin of 2^-16."""
        low, high = np.asarray(bounds_world, np.float64)
        side = float((high - low).max()) * _MARGIN
        x, y, z = (low + high) / 2 - side / 2
        return cls((float(x), float(y), float(z)), side, depth)

    @classmethod
    def with_voxel_size(cls, bounds_world: np.ndarray, voxel_size_world: float) -> Grid:
        """Cube around `bounds_world` whose leaves have exactly the side `voxel_size_world`."""
        if not (np.isfinite(voxel_size_world) and voxel_size_world > 0):
            raise SettingError(f"Voxel size {voxel_size_world} must be a positive length")
        low, high = np.asarray(bounds_world, np.float64)
        extent = float((high - low).max()) * _MARGIN
        depth = max(1, int(np.ceil(np.log2(max(extent / voxel_size_world, 1.0)))))
        if depth > MAX_DEPTH:
            raise SettingError(
                f"Voxel size {voxel_size_world:g} is too small for a scene that is {extent:.4g} long: it would take "
                f"depth {depth}, where {MAX_DEPTH} is the most; choose at least {extent / 2**MAX_DEPTH:.2g}"
            )
        side = voxel_size_world * 2.0**depth
        x, y, z = (low + high) / 2 - side / 2
        return cls((float(x), float(y), float(z)), side, depth)

    @property
    def voxel_size_world(self) -> float:
        """Side of a leaf in world units."""
        return self.side_world / (1 << self.depth)

    def to_unit(self, points_world: np.ndarray) -> np.ndarray:
        """World points (..., 3) in the cube's coordinates, [0, 1]^3 inside."""
        return (np.asarray(points_world, np.float64) - self.origin_world) / self.side_world

    def to_world(self, points_unit: np.ndarray) -> np.ndarray:
        """Inverse of `to_unit`."""
        return np.asarray(points_unit, np.float64) * self.side_world + self.origin_world
