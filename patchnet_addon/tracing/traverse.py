# SPDX-License-Identifier: GPL-3.0-or-later
"""Traverse the octree to the first hit of a ray under the level-of-detail contract (methods 4.1, 4.1b).

The ray is mirrored so that it runs upwards on every axis. The walk keeps the integer cell it is in and its level;
all plane distances are computed from integers, so nothing drifts. A cell that exists and need not be divided is the
hit; one that must be divided is entered; an empty one is left through its nearest face, climbing to the level whose
cell changes.
"""

from __future__ import annotations

import numpy as np

from ..cells.contract import fits_pixel
from ..runtime.kernels import device

_FAR = 1e300
_TINY = 1e-150


@device
def _bit_length(value):  # type: ignore[no-untyped-def]
    length = 0
    while value > 0:
        value >>= 1
        length += 1
    return length


@device
def _child(child_mask, first_child, node, octant):  # type: ignore[no-untyped-def]
    """Index of a child, -1 if it does not exist."""
    mask = child_mask[node]
    if (mask >> octant) & 1 == 0:
        return np.int64(-1)
    below = mask & ((1 << octant) - 1)
    count = 0
    while below:
        below &= below - 1
        count += 1
    return np.int64(first_child[node]) + count


@device
def _upwards(origin, direction):  # type: ignore[no-untyped-def]
    """Mirror one axis of a ray so that it does not run downwards: origin, 1 / direction, whether it was mirrored."""
    if direction < 0.0:
        return 1.0 - origin, 1.0 / max(-direction, _TINY), 1
    return origin, 1.0 / max(direction, _TINY), 0


@device
def first_hit(child_mask, first_child, origin, direction, t_start, z0, dz, side0, side_per_z, stack, cell):  # type: ignore[no-untyped-def]
    """Node, level and t of the first voxel that the ray meets and that fits its pixel, or is a leaf; node -1 if none.

    origin, direction: (3,) float64 in the unit cube; t in units of the direction. t_start: where the walk begins.
    z0 + t * dz is the axial distance at t; side0 + side_per_z * z the pixel side there. A voxel of side s stops the ray
    if s < 2 * pixel side at its entry point. stack: (MAX_LEVELS,) int64 scratch. cell: (3,) int64, becomes the voxel's.
    """
    ox, inv_x, mirror_x = _upwards(origin[0], direction[0])
    oy, inv_y, mirror_y = _upwards(origin[1], direction[1])
    oz, inv_z, mirror_z = _upwards(origin[2], direction[2])
    mirror = mirror_x | mirror_y << 1 | mirror_z << 2
    t = max(max(-ox * inv_x, -oy * inv_y), max(-oz * inv_z, t_start))
    t_leave = min(min((1.0 - ox) * inv_x, (1.0 - oy) * inv_y), (1.0 - oz) * inv_z)
    if not t < t_leave:
        return np.int64(-1), 0, _FAR
    level = 0
    size = 1.0
    ix = np.int64(0)
    iy = np.int64(0)
    iz = np.int64(0)
    node = np.int64(0)
    while True:
        if node >= 0:
            pixel = side0 + side_per_z * (z0 + t * dz)
            if child_mask[node] == 0 or fits_pixel(size, pixel):
                top = (np.int64(1) << level) - 1
                cell[0] = top - ix if mirror_x else ix
                cell[1] = top - iy if mirror_y else iy
                cell[2] = top - iz if mirror_z else iz
                return node, level, t
            stack[level] = node
            level += 1
            size *= 0.5
            ix <<= 1
            iy <<= 1
            iz <<= 1
            if ((ix + 1) * size - ox) * inv_x <= t:
                ix += 1
            if ((iy + 1) * size - oy) * inv_y <= t:
                iy += 1
            if ((iz + 1) * size - oz) * inv_z <= t:
                iz += 1
        else:
            tx = ((ix + 1) * size - ox) * inv_x
            ty = ((iy + 1) * size - oy) * inv_y
            tz = ((iz + 1) * size - oz) * inv_z
            t_exit = min(min(tx, ty), tz)
            changed = np.int64(0)
            if tx <= t_exit:
                changed |= ix ^ (ix + 1)
                ix += 1
            if ty <= t_exit:
                changed |= iy ^ (iy + 1)
                iy += 1
            if tz <= t_exit:
                changed |= iz ^ (iz + 1)
                iz += 1
            t = max(t, t_exit)
            climb = _bit_length(changed) - 1
            if climb >= level:
                return np.int64(-1), 0, _FAR
            level -= climb
            ix >>= climb
            iy >>= climb
            iz >>= climb
            size *= 1.0 * (1 << climb)
        octant = ((ix & 1) | ((iy & 1) << 1) | ((iz & 1) << 2)) ^ mirror
        node = _child(child_mask, first_child, stack[level - 1], octant)


@device
def first_seen(child_mask, first_child, origin, direction, speed, lens, footprint, stack, cell):  # type: ignore[no-untyped-def]
    """Find `first_hit` of a ray of `pixel_ray` between the lens's planes of sight; footprint scales the pixel side."""
    node, level, t = first_hit(
        child_mask, first_child, origin, direction, lens[4] / speed, 0.0, speed, footprint * lens[2],
        footprint * lens[3], stack, cell,
    )  # fmt: skip
    if node >= 0 and t * speed > lens[5]:
        return np.int64(-1), 0, _FAR
    return node, level, t


@device
def pixel_ray(frame, lens, perspective, x, y, origin, direction):  # type: ignore[no-untyped-def]
    """Ray through picture coordinates x, y in [-1, 1] (right and up); returns its axial speed.

    A perspective ray starts at the camera; an orthographic one in the camera's plane. direction has unit length.
    """
    sx = x + lens[0]
    sy = y + lens[1]
    length = 0.0
    for axis in range(3):
        offset = sx * frame[1, axis] + sy * frame[2, axis]
        if perspective:
            origin[axis] = frame[0, axis]
            direction[axis] = frame[3, axis] + offset
        else:
            origin[axis] = frame[0, axis] + offset
            direction[axis] = frame[3, axis]
        length += direction[axis] * direction[axis]
    length = np.sqrt(length)
    for axis in range(3):
        direction[axis] /= length
    return 1.0 / length if perspective else 1.0
