# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of an octree: first hits, and the luminance behind a patch (methods 3.12, 4.1b).

All pictures are (H * W,) with row 0 at the bottom, as Blender stores them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from ..cells.contract import MAX_LEVELS, pixel_voxel_ratio
from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import kernel
from .camera import Camera, camera_in_unit_cube
from .traverse import first_hit, first_seen, pixel_ray


@dataclass(frozen=True, eq=False)
class Hits:
    """Hits of the centre ray of each pixel; P = height * width.

    node: (P,) int64, -1 for a miss. level: (P,) int32. cell: (P, 3) int32 of the voxel at its level.
    t_world, z_world: (P,) float32 ray length and axial distance of the entry point, inf for a miss.
    ratio: (P,) float32 pixel side / voxel side, clamped to [1/2, 1] (methods 7.8).
    entry_voxel: (P, 3) float32 entry point inside the voxel, [0, 1]^3.
    direction, up: (P, 3) float32, ray direction and the picture's up orthogonal to it (methods 7.14).
    luminance: (P,) float32 of the voxel; background for a miss.
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
    up: np.ndarray
    luminance: np.ndarray

    @property
    def hit(self) -> np.ndarray:
        """(P,) bool."""
        return self.node >= 0


def first_hits(octree: Octree, camera: Camera, background: float = 0.0) -> Hits:
    """Trace a ray through every pixel centre, stopped by the level-of-detail contract."""
    unit = camera_in_unit_cube(camera, octree.grid)
    pixels = camera.pixel_count
    node = np.empty(pixels, np.int64)
    level = np.empty(pixels, np.int32)
    cell = np.empty((pixels, 3), np.int32)
    t_unit = np.empty((pixels, 2), np.float64)  # along the ray, along the axis
    ratio = np.empty(pixels, np.float32)
    entry = np.empty((pixels, 3), np.float32)
    direction = np.empty((pixels, 3), np.float32)
    _first_hits(
        octree.child_mask, octree.first_child, *unit, node, level, cell, t_unit, ratio, entry, direction,
    )  # fmt: skip
    luminance = np.full(pixels, background, np.float32)
    hit = node >= 0
    luminance[hit] = octree.luminance_float(node[hit])
    t_world = np.where(hit[:, None], t_unit * octree.grid.side_world, np.inf).astype(np.float32)
    return Hits(
        camera.width_px, camera.height_px, node, level, cell, t_world[:, 0], t_world[:, 1], ratio, entry, direction,
        ray_up(direction, camera.up), luminance,
    )  # fmt: skip


def hit_colors(octree: Octree, hits: Hits, background: float = 0.0) -> np.ndarray:
    """Linear colours (P, 3) float32 of what the rays met, with the luminance of `hits`; gray without colour."""
    colors = np.full((len(hits.node), 3), background, np.float32)
    colors[hits.hit] = octree.color_float(hits.node[hits.hit])
    return colors


def ray_up(direction: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Camera's up (3,) made orthogonal to each ray (P, 3): normalise(u - (u.w) w) (methods 7.14)."""
    up = np.asarray(up, np.float64)
    along = direction.astype(np.float64) @ up
    across = up - along[:, None] * direction
    return (across / np.linalg.norm(across, axis=1, keepdims=True)).astype(np.float32)


@kernel
def _first_hits(
    child_mask, first_child, frame, lens, perspective, width, height, node, level, cell, t_unit, ratio, entry, direction
):  # type: ignore[no-untyped-def]
    for row in numba.prange(height):
        stack = np.empty(MAX_LEVELS, np.int64)
        found = np.empty(3, np.int64)
        ray_o = np.empty(3, np.float64)
        ray_d = np.empty(3, np.float64)
        for column in range(width):
            pixel = row * width + column
            x = (2.0 * column + 1.0) / width - 1.0
            y = (2.0 * row + 1.0) / height - 1.0
            speed = pixel_ray(frame, lens, perspective, x, y, ray_o, ray_d)
            hit, depth, t = first_seen(child_mask, first_child, ray_o, ray_d, speed, lens, 1.0, stack, found)
            node[pixel] = hit
            level[pixel] = depth
            for axis in range(3):
                direction[pixel, axis] = ray_d[axis]
            if hit >= 0:
                scale = np.float64(1 << depth)
                side = lens[2] + lens[3] * t * speed
                ratio[pixel] = pixel_voxel_ratio(side, scale)
                t_unit[pixel, 0] = t
                t_unit[pixel, 1] = t * speed
                for axis in range(3):
                    cell[pixel, axis] = found[axis]
                    local = (ray_o[axis] + t * ray_d[axis]) * scale - found[axis]
                    entry[pixel, axis] = min(max(local, 0.0), 1.0)
            else:
                ratio[pixel] = 1.0
                t_unit[pixel, :] = 0.0
                for axis in range(3):
                    cell[pixel, axis] = -1
                    entry[pixel, axis] = 0.0


def behind(
    octree: Octree,
    camera: Camera,
    hits: Hits,
    background: float = 0.0,
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
) -> np.ndarray:
    """Luminance (P,) float32 of each ray's next voxel; the ray restarts 1.5 sides beyond its entry (methods 3.12).

    It runs with the footprint of a patch's fine voxels, `lookahead` levels below the pixel's: a coarse one would meet
    the grown outline of the very surface whose gaps it is to look through.
    """
    unit = camera_in_unit_cube(camera, octree.grid)
    lens = unit.lens.copy()
    lens[2:4] /= 2.0**lookahead
    out = np.full(camera.pixel_count, background, np.float32)
    t_unit = np.where(hits.hit, hits.t_world / octree.grid.side_world, 0.0).astype(np.float64)
    _behind(
        octree.child_mask, octree.first_child, octree.luminance, unit.frame, lens, unit.perspective,
        unit.width_px, unit.height_px, hits.node, hits.level, t_unit, out,
    )  # fmt: skip
    return out


@kernel
def _behind(child_mask, first_child, luminance, frame, lens, perspective, width, height, node, level, t_unit, out):  # type: ignore[no-untyped-def]
    for row in numba.prange(height):
        stack = np.empty(MAX_LEVELS, np.int64)
        found = np.empty(3, np.int64)
        ray_o = np.empty(3, np.float64)
        ray_d = np.empty(3, np.float64)
        for column in range(width):
            pixel = row * width + column
            if node[pixel] < 0:
                continue
            x = (2.0 * column + 1.0) / width - 1.0
            y = (2.0 * row + 1.0) / height - 1.0
            speed = pixel_ray(frame, lens, perspective, x, y, ray_o, ray_d)
            start = t_unit[pixel] + 1.5 / np.float64(1 << level[pixel])
            hit, _, t = first_hit(
                child_mask, first_child, ray_o, ray_d, start, 0.0, speed, lens[2], lens[3], stack, found
            )
            if hit >= 0 and t * speed <= lens[5]:
                out[pixel] = luminance[hit] / LUMINANCE_SCALE
