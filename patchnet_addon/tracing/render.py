# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of an octree: first hits, and the luminance behind a patch (methods 3.12, 4.1b).

All pictures are (H * W,) with row 0 at the bottom, as Blender stores them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from ..cells.contract import MAX_LEVELS, pixel_voxel_ratio
from ..octree.octree import LUMINANCE_SCALE, Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import device, kernel
from .camera import Camera, camera_in_unit_cube
from .traverse import PixelSide, first_hit, first_seen, pixel_ray


class _Traced(NamedTuple):
    """Hits of P pixels as the kernel writes them: those of `Hits`, and t_unit.

    t_unit: (P, 2) float64, length of the ray and axial distance in the unit cube; 0 for a miss.
    """

    node: np.ndarray
    level: np.ndarray
    cell: np.ndarray
    t_unit: np.ndarray
    ratio: np.ndarray
    entry: np.ndarray
    direction: np.ndarray


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
    traced = _Traced(
        node=np.empty(pixels, np.int64),
        level=np.empty(pixels, np.int32),
        cell=np.empty((pixels, 3), np.int32),
        t_unit=np.empty((pixels, 2), np.float64),
        ratio=np.empty(pixels, np.float32),
        entry=np.empty((pixels, 3), np.float32),
        direction=np.empty((pixels, 3), np.float32),
    )
    _first_hits(octree.nodes, unit, traced)
    luminance = np.full(pixels, background, np.float32)
    hit = traced.node >= 0
    luminance[hit] = octree.luminance_float(traced.node[hit])
    t_world = np.where(hit[:, None], traced.t_unit * octree.grid.side_world, np.inf).astype(np.float32)
    return Hits(
        width_px=camera.width_px,
        height_px=camera.height_px,
        node=traced.node,
        level=traced.level,
        cell=traced.cell,
        t_world=t_world[:, 0],
        z_world=t_world[:, 1],
        ratio=traced.ratio,
        entry_voxel=traced.entry,
        direction=traced.direction,
        up=ray_up(traced.direction, camera.up),
        luminance=luminance,
    )


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
def _first_hits(nodes, camera, traced):  # type: ignore[no-untyped-def]
    for row in numba.prange(camera.height_px):
        _trace_row(nodes, camera, np.int64(row), traced)  # prange's own integers would compile it twice


@device
def _trace_row(nodes, camera, row, traced):  # type: ignore[no-untyped-def]
    """Trace the pixels of a row and write into `traced`, which a parallel kernel cannot."""
    stack = np.empty(MAX_LEVELS, np.int64)
    for column in range(camera.width_px):
        pixel = row * camera.width_px + column
        x = (2.0 * column + 1.0) / camera.width_px - 1.0
        y = (2.0 * row + 1.0) / camera.height_px - 1.0
        ray = pixel_ray(camera, x, y)
        hit = first_seen(nodes, camera, ray, 1.0, stack)
        traced.node[pixel] = hit.node
        traced.level[pixel] = hit.level
        for axis in range(3):
            traced.direction[pixel, axis] = ray.direction[axis]
        if hit.node >= 0:
            scale = np.float64(1 << hit.level)
            side = camera.side_at_0 + camera.side_per_z * hit.t * ray.speed
            traced.ratio[pixel] = pixel_voxel_ratio(side, scale)
            traced.t_unit[pixel, 0] = hit.t
            traced.t_unit[pixel, 1] = hit.t * ray.speed
            for axis in range(3):
                traced.cell[pixel, axis] = hit.cell[axis]
                local = (ray.origin[axis] + hit.t * ray.direction[axis]) * scale - hit.cell[axis]
                traced.entry[pixel, axis] = min(max(local, 0.0), 1.0)
        else:
            traced.ratio[pixel] = 1.0
            traced.t_unit[pixel, :] = 0.0
            for axis in range(3):
                traced.cell[pixel, axis] = -1
                traced.entry[pixel, axis] = 0.0


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
    unit = camera_in_unit_cube(camera, octree.grid).finer(2.0**lookahead)
    out = np.full(camera.pixel_count, background, np.float32)
    t_unit = np.where(hits.hit, hits.t_world / octree.grid.side_world, 0.0).astype(np.float64)
    _behind(octree.nodes, octree.luminance, unit, hits.node, hits.level, t_unit, out)
    return out


@kernel
def _behind(nodes, luminance, camera, node, level, t_unit, out):  # type: ignore[no-untyped-def]
    for row in numba.prange(camera.height_px):
        stack = np.empty(MAX_LEVELS, np.int64)
        for column in range(camera.width_px):
            pixel = row * camera.width_px + column
            if node[pixel] < 0:
                continue
            x = (2.0 * column + 1.0) / camera.width_px - 1.0
            y = (2.0 * row + 1.0) / camera.height_px - 1.0
            ray = pixel_ray(camera, x, y)
            start = t_unit[pixel] + 1.5 / np.float64(1 << level[pixel])
            hit = first_hit(nodes, ray, start, PixelSide(camera.side_at_0, camera.side_per_z), stack)
            if hit.node >= 0 and hit.t * ray.speed <= camera.farthest:
                out[pixel] = luminance[hit.node] / LUMINANCE_SCALE
