# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits of a view's rays, pixel by pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Hits(NamedTuple):
    """Hits of the centre ray of each pixel; P = height * width.

    node: (P,) int64, -1 for a miss. level: (P,) int32. cell: (P, 3) int32 of the voxel at its level.
    t_world, z_world: (P,) float32 ray length and axial distance of the entry point, inf for a miss.
    ratio: (P,) float32 pixel side / voxel side, clamped to [1/2, 1] (methods 7.8).
    entry_voxel: (P, 3) float32 entry point inside the voxel, [0, 1]^3.
    direction: (P, 3) float32, ray direction. camera_up: (3,) float64, the picture's up.
    patch_end: (P,) float64, length at which the ray has left its patch, in the octree's cube; inf for a miss.
    luminance: (P,) float32 of the voxel; 0 for a miss.
    """

    width_px: int
    height_px: int
    node: np.ndarray
    level: np.ndarray
    cell: np.ndarray
    t_world: np.ndarray
    z_world: np.ndarray
    ratio: np.ndarray
    entry_voxel: np.ndarray
    direction: np.ndarray
    patch_end: np.ndarray
    camera_up: np.ndarray
    luminance: np.ndarray

    @property
    def hit(self) -> np.ndarray:
        """(P,) bool."""
        return self.node >= 0

    @property
    def up(self) -> np.ndarray:
        """(P, 3) float32, the picture's up orthogonal to each ray (methods 7.14); computed at each call."""
        from .ray_up import ray_up  # a kernel

        return ray_up(self.direction, self.camera_up)
