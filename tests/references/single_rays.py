# SPDX-License-Identifier: GPL-3.0-or-later
"""Traverse the octree one ray at a time: what tiles are held against.

The first hit of a ray is found under the level-of-detail contract (methods 4.1, 4.1b). The ray is mirrored so that it
runs upwards on every axis. The walk keeps the integer cell it is in and its level; all plane distances are computed
from integers, so nothing drifts. A cell that exists and need not be divided is the hit; one that must be divided is
entered; an empty one is left through its nearest face, climbing to the level whose cell changes. So is a leaf whose box
the ray does not meet.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from patchnet.patchnet_addon.cells.contract import MAX_LEVELS, fits_pixel
from patchnet.patchnet_addon.octree.leaf_boxes import STEPS, mirrored_span
from patchnet.patchnet_addon.octree.octree import LUMINANCE_SCALE, Octree
from patchnet.patchnet_addon.runtime.kernels import device, kernel
from patchnet.patchnet_addon.runtime.threads import run_parts
from patchnet.patchnet_addon.tracing.camera import Camera, camera_in_unit_cube

_FAR = 1e300
_TINY = 1e-150


def single_hits(
    octree: Octree, camera: Camera, finer: float = 1.0, start: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Node (P,) int64, -1 for a miss, level (P,) int64 and length (P,) float64 in the unit cube, of all pixels.

    finer: pixel side over that of the footprint. start: (P,) float64 lengths where the rays begin, if they do not begin
    where the camera sees.
    """
    unit = camera_in_unit_cube(camera, octree.grid).finer(finer)
    count = camera.pixel_count
    node, level, t = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count)
    begin = np.full(count, -1.0) if start is None else start
    run_parts(_trace, camera.height_px, octree.boxed_nodes, unit, begin, node, level, t)
    return node, level, t


def single_means(octree: Octree, camera: Camera, pixels: np.ndarray, side: int) -> np.ndarray:
    """Mean luminance (N,) float32 of side x side rays of each pixel (N,), as `supersample_pixels`."""
    unit = camera_in_unit_cube(camera, octree.grid).finer(side)
    means = np.empty(len(pixels), np.float32)
    run_parts(
        _trace_means, len(pixels), octree.boxed_nodes, octree.luminance, unit, np.asarray(pixels, np.int64), side, means
    )
    return means


@kernel
def _trace(first, last, nodes, camera, start, node, level, t):  # type: ignore[no-untyped-def]
    for row in range(first, last):
        stack = np.empty(MAX_LEVELS, np.int64)
        for column in range(camera.width_px):
            pixel = row * camera.width_px + column
            x = (2.0 * column + 1.0) / camera.width_px - 1.0
            y = (2.0 * row + 1.0) / camera.height_px - 1.0
            ray = pixel_ray(camera, x, y)
            begin = start[pixel] if start[pixel] >= 0.0 else camera.nearest / ray.speed
            hit = first_hit(nodes, ray, begin, PixelSide(camera.side_at_0, camera.side_per_z), stack)
            seen = hit.node >= 0 and hit.t * ray.speed <= camera.farthest
            node[pixel] = hit.node if seen else -1
            level[pixel] = hit.level if seen else 0
            t[pixel] = hit.t if seen else np.inf


@kernel
def _trace_means(begin, end, nodes, luminance, camera, pixels, side, means):  # type: ignore[no-untyped-def]
    for index in range(begin, end):
        row = pixels[index] // camera.width_px
        column = pixels[index] % camera.width_px
        stack = np.empty(MAX_LEVELS, np.int64)
        total = 0.0
        for j in range(side):
            y = 2.0 * (row + (j + 0.5) / side) / camera.height_px - 1.0
            for i in range(side):
                x = 2.0 * (column + (i + 0.5) / side) / camera.width_px - 1.0
                node = first_seen(nodes, camera, pixel_ray(camera, x, y), 1.0, stack).node
                total += luminance[node] / LUMINANCE_SCALE if node >= 0 else 0.0
        means[index] = total / (side * side)


class Ray(NamedTuple):
    """Ray in the unit cube: origin, direction of unit length, and axial distance per unit of its length."""

    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    speed: float


class PixelSide(NamedTuple):
    """Side of a pixel at axial distance z, at_0 + per_z * z: a voxel below twice that stops a ray (methods 4.1b)."""

    at_0: float
    per_z: float


class Hit(NamedTuple):
    """Voxel that a ray met: its node, -1 for none, its level, the ray's length to it, and its cell on that level."""

    node: np.int64
    level: np.int64
    t: float
    cell: tuple[np.int64, np.int64, np.int64]


_MISS = Hit(np.int64(-1), np.int64(0), _FAR, (np.int64(0), np.int64(0), np.int64(0)))


@device
def _bit_length(value):  # type: ignore[no-untyped-def]
    length = 0
    while value > 0:
        value >>= 1
        length += 1
    return length


@device
def _child(nodes, node, octant):  # type: ignore[no-untyped-def]
    """Index of a child, -1 if it does not exist."""
    mask = nodes.child_mask[node]
    if (mask >> octant) & 1 == 0:
        return np.int64(-1)
    below = mask & ((1 << octant) - 1)
    count = 0
    while below:
        below &= below - 1
        count += 1
    return np.int64(nodes.first_child[node]) + count


@device
def _upwards(origin, direction):  # type: ignore[no-untyped-def]
    """Mirror one axis of a ray so that it does not run downwards: origin, 1 / direction, whether it was mirrored."""
    if direction < 0.0:
        return 1.0 - origin, 1.0 / max(-direction, _TINY), 1
    return origin, 1.0 / max(direction, _TINY), 0


@device
def _box_entry(box, mirror, cell, step, ray, t_start):  # type: ignore[no-untyped-def]
    """Length at which a ray enters the box of a leaf, -1 if it does not meet it.

    cell: mirrored. step: a sixteenth of its side. ray: mirrored origin (x, y, z) and 1 / direction (x, y, z).
    """
    enter, leave = t_start, _FAR
    for axis in range(3):
        first, last = mirrored_span(box[axis], (mirror >> axis) & 1)
        low = (STEPS * cell[axis] + first) * step
        high = (STEPS * cell[axis] + last + 1) * step
        enter = max(enter, (low - ray[axis]) * ray[3 + axis])
        leave = min(leave, (high - ray[axis]) * ray[3 + axis])
    return enter if enter < leave else -1.0


@device
def _next_cell(cell, size, ray):  # type: ignore[no-untyped-def]
    """Cell behind the nearest face of one, the length at which the ray gets there, and which bits of the cell change.

    ray: mirrored origin (x, y, z) and 1 / direction (x, y, z).
    """
    x, y, z = cell
    to_x = ((x + 1) * size - ray[0]) * ray[3]
    to_y = ((y + 1) * size - ray[1]) * ray[4]
    to_z = ((z + 1) * size - ray[2]) * ray[5]
    t_exit = min(min(to_x, to_y), to_z)
    changed = np.int64(0)
    if to_x <= t_exit:
        changed |= x ^ (x + 1)
        x += 1
    if to_y <= t_exit:
        changed |= y ^ (y + 1)
        y += 1
    if to_z <= t_exit:
        changed |= z ^ (z + 1)
        z += 1
    return (x, y, z), t_exit, changed


@device
def first_hit(nodes, ray, t_start, pixel_side, stack):  # type: ignore[no-untyped-def]
    """First voxel (a `Hit`) that the ray meets from t_start on and that fits its pixel, or is a leaf.

    A voxel of side s stops the ray if s < 2 * pixel side at its entry point. nodes: `Nodes`. pixel_side: `PixelSide`.
    stack: (MAX_LEVELS,) int64 scratch.
    """
    ox, inv_x, mirror_x = _upwards(ray.origin[0], ray.direction[0])
    oy, inv_y, mirror_y = _upwards(ray.origin[1], ray.direction[1])
    oz, inv_z, mirror_z = _upwards(ray.origin[2], ray.direction[2])
    mirror = mirror_x | mirror_y << 1 | mirror_z << 2
    t = max(max(-ox * inv_x, -oy * inv_y), max(-oz * inv_z, t_start))
    t_leave = min(min((1.0 - ox) * inv_x, (1.0 - oy) * inv_y), (1.0 - oz) * inv_z)
    if not t < t_leave:
        return _MISS
    level, size, node = np.int64(0), 1.0, np.int64(0)
    ix, iy, iz = np.int64(0), np.int64(0), np.int64(0)
    while True:
        if node >= 0:
            pixel = pixel_side.at_0 + pixel_side.per_z * (t * ray.speed)
            if nodes.child_mask[node] == 0 or fits_pixel(size, pixel):
                met = t
                if node >= nodes.first_boxed:
                    away = ox, oy, oz, inv_x, inv_y, inv_z
                    box = nodes.boxes[node - nodes.first_boxed]
                    met = _box_entry(box, mirror, (ix, iy, iz), size / STEPS, away, t_start)
                if met >= 0.0:
                    top = (np.int64(1) << level) - 1
                    x = top - ix if mirror_x else ix
                    y = top - iy if mirror_y else iy
                    z = top - iz if mirror_z else iz
                    return Hit(node, level, met, (x, y, z))
                node = np.int64(-1)
                continue
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
            cell, t_exit, changed = _next_cell((ix, iy, iz), size, (ox, oy, oz, inv_x, inv_y, inv_z))
            ix, iy, iz = cell
            t = max(t, t_exit)
            climb = _bit_length(changed) - 1
            if climb >= level:
                return _MISS
            level -= climb
            ix >>= climb
            iy >>= climb
            iz >>= climb
            size *= 1.0 * (1 << climb)
        octant = ((ix & 1) | ((iy & 1) << 1) | ((iz & 1) << 2)) ^ mirror
        node = _child(nodes, stack[level - 1], octant)


@device
def first_seen(nodes, camera, ray, footprint, stack):  # type: ignore[no-untyped-def]
    """Find `first_hit` of a ray of `pixel_ray` where the camera sees; footprint scales the pixel side."""
    pixel_side = PixelSide(footprint * camera.side_at_0, footprint * camera.side_per_z)
    hit = first_hit(nodes, ray, camera.nearest / ray.speed, pixel_side, stack)
    if hit.node >= 0 and hit.t * ray.speed > camera.farthest:
        return _MISS
    return hit


@device
def pixel_ray(camera, x, y):  # type: ignore[no-untyped-def]
    """Ray of a `CameraUnit` through picture coordinates x, y in [-1, 1] (right and up).

    A perspective ray starts at the camera; an orthographic one in the camera's plane.
    """
    pose = camera.pose
    sx = x + camera.shift_x
    sy = y + camera.shift_y
    ox, oy, oz = pose[0, 0], pose[0, 1], pose[0, 2]
    dx, dy, dz = pose[3, 0], pose[3, 1], pose[3, 2]
    across_x = sx * pose[1, 0] + sy * pose[2, 0]
    across_y = sx * pose[1, 1] + sy * pose[2, 1]
    across_z = sx * pose[1, 2] + sy * pose[2, 2]
    if camera.perspective:
        dx, dy, dz = dx + across_x, dy + across_y, dz + across_z
    else:
        ox, oy, oz = ox + across_x, oy + across_y, oz + across_z
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    speed = 1.0 / length if camera.perspective else 1.0
    return Ray((ox, oy, oz), (dx / length, dy / length, dz / length), speed)
