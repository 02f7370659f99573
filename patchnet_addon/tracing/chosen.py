# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays of chosen pixels only, so that the cost grows with their number.

Pixels of a block of the picture share a tile, as in whole pictures, so that a tile's rays visit few nodes. They hit the
same voxels as those of whole pictures (`render.py`), bit for bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..directional.node_light import NodeLight
from ..octree.octree import Nodes, Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..runtime.vectors import LANES
from .camera import Camera, CameraUnit, camera_in_unit_cube
from .pixel_filter import grid_places
from .render import finer_than_pixel
from .tile import (
    COARSE,
    PICTURE,
    PIXEL,
    SAMPLE,
    TILE,
    WANTED,
    Search,
    aim_tile,
    luminance_of_ray,
    make_levels,
    make_tile,
    node_seen,
    ray_of,
)
from .tile_walk import trace_tile


class Chosen(NamedTuple):
    """Pixels (N,) by blocks, their places (N,) in results, and the bounds (B + 1,) of the blocks; side: of their rays.

    rays: (side^2, 2) places of rays in a pixel, the lowest row first.
    """

    pixels: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    side: int
    rays: np.ndarray

    @classmethod
    def by_blocks(cls, pixels: np.ndarray, width_px: int, side: int, rays: np.ndarray) -> Chosen:
        """Pixels (N,) of a picture."""
        order, starts = blocks(pixels, width_px, side)
        return cls(pixels[order], order, starts, side, rays)


def fine_rays(octree: Octree, camera: Camera, *, lookahead: int = DEFAULT_LOOKAHEAD) -> np.ndarray:
    """Luminances (P, 4) float32 of 2x2 rays in each pixel with a finer footprint (`finer_than_pixel`).

    Lower row first, left to right; 0 for a miss.
    """
    pixels = np.arange(camera.pixel_count)
    unit = camera_in_unit_cube(camera, octree.grid)
    footprint = finer_than_pixel(lookahead)
    finer = unit.finer(footprint)
    search = Search(finer.side_at_0, finer.side_per_z, 1.0, COARSE)
    chosen = Chosen.by_blocks(pixels, unit.width_px, 2, grid_places(2))
    seen = np.empty((len(pixels), 4), np.float32)
    run_parts(_trace_blocks, len(chosen.starts) - 1, (octree.nodes, octree.light), unit, search, chosen, seen)
    return seen


def blocks(pixels: np.ndarray, width_px: int, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Order (N,) of pixels (N,) by blocks of the picture whose side x side rays fit a tile.

    Also the bounds (B + 1,) of the blocks in it. A pixel that does not fit is a block by itself.
    """
    across = TILE // side
    if across < 2:
        return np.arange(len(pixels)), np.arange(len(pixels) + 1)
    row, column = np.divmod(pixels, width_px)
    block = row // across * width_px + column // across
    order = np.argsort(block, kind="stable")
    ends = np.flatnonzero(np.diff(block[order], append=-1)) + 1
    return order, np.concatenate([np.zeros(1, np.int64), ends])


@kernel
def _trace_blocks(
    first: int, last: int, scene: tuple[Nodes, NodeLight], camera: CameraUnit, search: Search, chosen: Chosen,
    seen: np.ndarray,
) -> None:  # fmt: skip
    """Write the luminances that rays of pixels see, one block per tile. chosen: `Chosen`."""
    nodes, light = scene
    pixels, places, starts, side, rays = chosen
    tile, levels = make_tile(), make_levels()
    for block in range(first, last):
        here = slice(starts[block], starts[block + 1])
        aim_pixels(camera, tile, pixels[here], (0, 0), side, rays)
        trace_tile(nodes, search, tile, levels)
        for index in range(starts[block], starts[block + 1]):
            top, left = corner_of(camera, pixels[index], side)
            place = places[index]
            for j in range(side):
                for i in range(side):
                    ray = ray_of(top + j, left + i)
                    node = node_seen(camera, tile, search.last, ray)
                    met = luminance_of_ray(light, node, tile, ray) if node >= 0 else np.float32(0)
                    seen[place, side * j + i] = met


@device
def aim_pixels(camera, tile, pixels, corner, side, rays):
    """Set the rays of a tile to those of a block's pixels: of side x side those from row and column `corner` on.

    rays: (side^2, 2) their places in a pixel, the lowest row first.
    """
    tile.lanes[WANTED, :] = 0
    for pixel in pixels:
        _aim_pixel(camera, tile, pixel, corner, side, rays)
    aim_tile(camera, tile)


@device
def corner_of(camera, pixel, side):
    """Row and column in a tile of a pixel's first ray."""
    within = max(TILE // side, 1) - 1  # pixels along a side of a tile are a power of two
    row = pixel // camera.width_px
    return side * (row & within), side * ((pixel - row * camera.width_px) & within)


@device
def _aim_pixel(camera, tile, pixel, corner, side, rays):
    """Give rays of a tile the picture coordinates of a pixel's rays from row and column `corner` on."""
    row = pixel // camera.width_px
    column = pixel - row * camera.width_px
    top, left = corner_of(camera, pixel, side)
    for j in range(min(TILE, side - corner[0])):
        for i in range(min(TILE, side - corner[1])):
            ray, sample = ray_of(top + j, left + i), side * (corner[0] + j) + corner[1] + i
            tile.numbers[PICTURE, ray] = 2.0 * (column + rays[sample, 0]) / camera.width_px - 1.0
            tile.numbers[PICTURE + 1, ray] = 2.0 * (row + rays[sample, 1]) / camera.height_px - 1.0
            tile.numbers[PIXEL, ray], tile.numbers[SAMPLE, ray] = top * TILE + left, sample
            tile.lanes[WANTED, ray // LANES] |= np.int64(1) << (ray % LANES)
