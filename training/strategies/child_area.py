# SPDX-License-Identifier: GPL-3.0-or-later
"""Projected area of the union of a voxel's child cubes, for all 256 child masks (methods 3.8).

In parallel projection every child cube has the same hexagonal outline, the intersection of three slabs with edges
parallel to the projected axes. Outlines of several children intersect in three slabs again, a polygon whose area has a
closed form, and the area of the union follows by inclusion and exclusion. Without rasterization the errors are those of
rounding, below 1e-9 of the voxel's side squared while products of a direction's components are above 1e-6.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.octree.octree import POPCOUNT

CHILDREN = 8
MASKS = 256
# Centres (8, 3) of the children, in sides of the voxel; child o is bit o of a mask, x + 2y + 4z.
CENTRES = np.array([(o & 1, o >> 1 & 1, o >> 2) for o in range(CHILDREN)]) / 2.0 - 0.25


def child_areas(directions: np.ndarray) -> np.ndarray:
    """Projected areas (256, N) float64 of the children of each mask along unit directions (N, 3).

    The unit is the voxel's side squared. No component of a direction may be 0.
    """
    directions = np.asarray(directions, np.float64)
    # A point p projects to p x w: its components are the offsets from the middle of the three slabs.
    centres = np.cross(CENTRES[:, None, :], directions)  # (8, N, 3)
    size = np.abs(directions)
    half_width = (size.sum(axis=1, keepdims=True) - size) / 4.0  # (N, 3), of a child's slabs
    shared = np.zeros((MASKS, len(directions)))
    for mask in range(1, MASKS):
        members = centres[[child for child in range(CHILDREN) if mask >> child & 1]]
        low, high = members.max(axis=0) - half_width, members.min(axis=0) + half_width
        shared[mask] = _area_of_slabs(directions, low, high)
    return _inclusion_exclusion() @ shared


def _area_of_slabs(directions: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Area (N,) of the points p x w between `low` and `high` (N, 3) in each component; 0 where a slab is empty.

    As w . (p x w) = 0, the third component follows from the first two: a strip across a rectangle. Its area is 1 /
    |w_z| of that in these two coordinates.
    """
    x, y, z = directions.T
    slope_x, slope_y = -x / z, -y / z

    def below(level: np.ndarray) -> np.ndarray:
        """Area of the rectangle where slope_x u + slope_y v <= level: second integral of a step at the corners."""
        total = np.zeros(len(directions))
        for u, v, sign in ((low, low, 1), (low, high, -1), (high, low, -1), (high, high, 1)):
            total += sign * np.maximum(level - slope_x * u[:, 0] - slope_y * v[:, 1], 0.0) ** 2
        return total / (2.0 * slope_x * slope_y)

    area = (below(high[:, 2]) - below(low[:, 2])) / np.abs(z)
    return np.where((low < high).all(axis=1), area, 0.0)


def _inclusion_exclusion() -> np.ndarray:
    """Signs (256, 256) of the area shared by each set of children in the area of the union of each mask."""
    masks = np.arange(MASKS)
    sign = np.where(POPCOUNT % 2 == 1, 1.0, -1.0)
    return np.where((masks & ~masks[:, None]) == 0, sign, 0.0)
