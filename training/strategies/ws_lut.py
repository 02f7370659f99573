# SPDX-License-Identifier: GPL-3.0-or-later
"""World-space look-up table: a voxel's error relative to its children, by child mask and direction (methods 3.8).

In parallel projection every child cube has the same hexagonal outline, the intersection of three slabs with edges
parallel to the projected axes. Outlines of several children intersect in three slabs again, a polygon whose area has a
closed form, and the area of the union follows by inclusion and exclusion. Without rasterization the errors are those of
rounding, below 1e-9 of the voxel's side squared while products of a direction's components are above 1e-6.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ...patchnet_addon.cells.morton import POPCOUNT
from ...patchnet_addon.network.harmonics import real_harmonics
from ...patchnet_addon.sampling.pixel_buffers import PixelBuffers
from ...patchnet_addon.sampling.strategy import CHILD_MASK, EXACT_1, Strategy

CHILDREN = 8
MASKS = 256
# Centres (8, 3) of the children, in sides of the voxel; child o is bit o of a mask, x + 2y + 4z.
CENTRES = np.array([(o & 1, o >> 1 & 1, o >> 2) for o in range(CHILDREN)]) / 2.0 - 0.25
DIRECTIONS = 4096
DEGREE = 2  # nine harmonics
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


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
    # Signs (256, 256) of the area shared by each set of children in the area of the union of each mask.
    masks = np.arange(MASKS)
    signs = np.where((masks & ~masks[:, None]) == 0, np.where(POPCOUNT % 2 == 1, 1.0, -1.0), 0.0)
    return signs @ shared


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


def fibonacci_directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3) float64, spread evenly over the sphere on a Fibonacci spiral."""
    number = np.arange(count)
    z = 1.0 - (2.0 * number + 1.0) / count
    radius, angle = np.sqrt(1.0 - z * z), number * _GOLDEN_ANGLE + 0.5  # so that no component is 0
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)


def child_errors(directions: np.ndarray) -> np.ndarray:
    """Errors e = 1 - A_mask / A_255 (256, N) of each child mask along unit directions (N, 3), in [0, 1].

    A: projected area of the union of the child cubes. Mask 0 is a leaf, which has no error.
    """
    areas = child_areas(directions)
    errors = 1.0 - areas / areas[-1]
    errors[0] = 0.0
    return errors


@cache
def child_error_table() -> np.ndarray:
    """Coefficients (256, 9) float64 of `child_errors` in real harmonics up to degree 2, fitted over 4096 directions."""
    directions = fibonacci_directions(DIRECTIONS)
    table = np.linalg.lstsq(real_harmonics(directions, DEGREE), child_errors(directions).T, rcond=None)[0].T
    table.flags.writeable = False  # shared by all callers
    return table


def _table_score(buffers: PixelBuffers) -> np.ndarray:
    """e = max(0, c . Y(w)) of the hit voxel's child mask; 0 for leaves and misses, whose mask is 0."""
    assert buffers.child_mask is not None  # required by `needs`
    harmonics = real_harmonics(buffers.hits.direction.astype(np.float64), DEGREE)
    return np.maximum(np.einsum("pk,pk->p", child_error_table()[buffers.child_mask], harmonics), 0.0)


def _coverage_score(buffers: PixelBuffers) -> np.ndarray:
    assert buffers.exact_1 is not None  # required by `needs`
    return np.where(buffers.hit, 1.0 - buffers.exact_1.coverage, 0.0)


STRATEGIES = (
    Strategy(
        name="ws-lut",
        title="World-space table",
        description="Share of the voxel's outline that its children leave empty, by child mask and direction",
        needs=frozenset({CHILD_MASK}),
        score=_table_score,
        quantity="missing area",
        maximum=1.0,
        group="world-space",
    ),
    Strategy(
        name="ws-lut-coverage",
        title="World-space coverage, exact",
        description="Share of the pixel that the voxels one level ahead leave empty, rendered instead of looked up",
        needs=frozenset({EXACT_1}),
        score=_coverage_score,
        quantity="missing coverage",
        maximum=1.0,
        group="world-space",
    ),
)
