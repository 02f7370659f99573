# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference of the traversal in plain NumPy: all rays against all children, level by level.

A (ray, node) pair whose box the ray meets is kept if the node stops the ray, divided otherwise; of all kept pairs of
a ray the nearest is its hit. Slow and readable; the tests hold the compiled walk against it.
"""

from __future__ import annotations

import itertools

import numpy as np

from patchnet.patchnet_addon.cells.contract import fitting_level_of
from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from patchnet.patchnet_addon.tracing.camera import Camera, camera_in_unit_cube
from patchnet.tests.references.lookups import box_bounds, fits_pixel_of


def picture_points(camera: Camera, across: float = 0.5, up: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Picture points (P,) from -1 to 1 at one place within each pixel, the centre by default."""
    row, column = np.divmod(np.arange(camera.pixel_count), camera.width_px)
    return 2.0 * (column + across) / camera.width_px - 1.0, 2.0 * (row + up) / camera.height_px - 1.0


def pixel_rays(grid: Grid, camera: Camera, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins (N, 3), unit directions (N, 3) in the cube and axial speeds (N,) through picture points in [-1, 1]."""
    unit = camera_in_unit_cube(camera, grid)
    position, right, up, forward = unit.pose
    offset = (x + unit.shift_x)[:, None] * right + (y + unit.shift_y)[:, None] * up  # (N, 3)
    if not unit.perspective:
        return position + offset, np.broadcast_to(forward, offset.shape), np.ones(len(x))
    direction = forward + offset
    length = np.linalg.norm(direction, axis=1)
    return np.broadcast_to(position, offset.shape), direction / length[:, None], 1.0 / length


def hits_of_pixels(
    octree: Octree, camera: Camera, finer: float = 1.0, start: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """`first_hits_reference` (P,) through the centres of all pixels; finer: pixel side over that of the footprint."""
    return first_hits_reference(octree, camera, *picture_points(camera), 1 / finer, start)


def shown_by(octree: Octree, nodes: np.ndarray) -> np.ndarray:
    """Luminance (N,) float32 of nodes (N,), 0 for -1."""
    return np.where(nodes >= 0, octree.luminance_float(np.maximum(nodes, 0)), np.float32(0.0))


def first_hits_reference(
    octree: Octree,
    camera: Camera,
    x: np.ndarray,
    y: np.ndarray,
    footprint: float = 1.0,
    start: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Node (N,) int64 (-1: miss) and t (N,) of rays through picture points; footprint scales the pixel side.

    start: (N,) where the rays begin, if not where the camera sees.
    """
    origin, direction, speed = pixel_rays(octree.grid, camera, x, y)
    unit = camera_in_unit_cube(camera, octree.grid)
    side_at_0, side_per_z = unit.side_at_0 * footprint, unit.side_per_z * footprint
    start = unit.nearest / speed if start is None else start
    with np.errstate(divide="ignore"):
        inverse = 1.0 / direction
    best_t = np.full(len(x), np.inf)
    best_node = np.full(len(x), -1, np.int64)
    ray = np.arange(len(x))
    node = np.zeros(len(x), np.int64)
    cell = np.zeros((len(x), 3), np.int64)
    for level in range(octree.depth + 1):
        size = 0.5**level
        enter, leave = box_interval(origin[ray], inverse[ray], cell * size, size)
        met = (enter < leave) & (leave > start[ray])
        ray, node, cell, enter = ray[met], node[met], cell[met], np.maximum(enter[met], start[ray[met]])
        pixel = side_at_0 + side_per_z * enter * speed[ray]
        stops = (octree.child_mask[node] == 0) | fits_pixel_of(size, pixel)
        if octree.leaf_box is not None and level == octree.depth:
            low, high = box_bounds(octree.leaf_box[node - octree.level_start[level]])
            enter, leave = box_interval(origin[ray], inverse[ray], (cell + low) * size, (high - low) * size)
            enter = np.maximum(enter, start[ray])
            stops = enter < leave
        for r, n, t in zip(ray[stops], node[stops], enter[stops], strict=True):
            if t < best_t[r]:
                best_t[r], best_node[r] = t, n
        ray, node, cell = _children(octree, ray[~stops], node[~stops], cell[~stops])
    seen = best_t * speed <= unit.farthest
    return np.where(seen, best_node, -1), np.where(seen, best_t, np.inf)


def supersampled_reference(octree: Octree, camera: Camera, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Reference of `supersample`: mean luminance (P,) and colours (P, 3) of side x side rays."""
    luminance, colors = np.zeros(camera.pixel_count), np.zeros((camera.pixel_count, 3))
    for j, i in itertools.product((np.arange(side) + 0.5) / side, repeat=2):
        node, _ = first_hits_reference(octree, camera, *picture_points(camera, i, j), 1 / side)
        luminance += shown_by(octree, node)
        colors += np.where(node[:, None] >= 0, octree.color_float(np.maximum(node, 0)), 0.0)
    return luminance / side**2, colors / side**2


def box_interval(
    origin: np.ndarray, inverse: np.ndarray, low: np.ndarray, size: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Ray parameters (...,) at which rays enter and leave the boxes from low (..., 3) to low + size.

    inverse: 1 / direction.
    """
    with np.errstate(invalid="ignore"):
        a, b = (low - origin) * inverse, (low + size - origin) * inverse
    near = np.nan_to_num(np.minimum(a, b), nan=-np.inf)
    far = np.nan_to_num(np.maximum(a, b), nan=np.inf)
    return near.max(axis=-1), far.min(axis=-1)


def _children(
    octree: Octree, ray: np.ndarray, node: np.ndarray, cell: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All existing children of (ray, node, cell) triples."""
    bits = (octree.child_mask[node][:, None] >> np.arange(8)) & 1  # (N, 8)
    index, octant = np.nonzero(bits)
    child = octree.first_child[node[index]].astype(np.int64) + (np.cumsum(bits, axis=1) - bits)[index, octant]
    offset = np.stack([octant & 1, octant >> 1 & 1, octant >> 2], axis=1)
    return ray[index], child, cell[index] * 2 + offset


def needed_levels_reference(
    octree: Octree,
    camera: Camera,
    block_level: int,
    offsets: np.ndarray,
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
    coarser: int = 0,
) -> np.ndarray:
    """Reference of `needed_levels`: levels (8^block_level,) of leaves that look-ahead takes where rays hit.

    offsets: (K, 2), of the fine rays from the pixels' centres, in pixels.
    """
    needed = np.zeros(8**block_level, np.uint8)
    for (x, y), finer, margin in [((0.0, 0.0), 0, 1), *((tuple(offset), lookahead, 0) for offset in offsets)]:
        sx, sy = picture_points(camera, 0.5 + x, 0.5 + y)
        node, t = first_hits_reference(octree, camera, sx, sy, 0.5 ** (finer + coarser))
        hit = node >= 0
        speed = pixel_rays(octree.grid, camera, sx, sy)[2]
        unit = camera_in_unit_cube(camera, octree.grid)
        pixel = unit.side_at_0 + unit.side_per_z * t[hit] * speed[hit]
        wanted = fitting_level_of(pixel / 2**coarser).astype(int) + lookahead
        for level, index, depth in zip(octree.level_of(node[hit]), node[hit], wanted, strict=True):
            cell = octree.cells(level)[index - octree.level_start[level]]
            low = np.floor((cell - margin) * 2.0 ** (block_level - level)).astype(int)
            high = np.ceil((cell + margin + 1) * 2.0 ** (block_level - level)).astype(int)
            ranges = (range(max(a, 0), min(b, 1 << block_level)) for a, b in zip(low, high, strict=True))
            blocks = morton_encode(np.array(list(itertools.product(*ranges)))).astype(np.int64)
            if depth > block_level:
                needed[blocks] = np.maximum(needed[blocks], depth)
    return needed
