# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer rays of chosen pixels alone, so that looking closer at some costs what these cost (methods 12.5).

They are the rays of `render.py`, which traces those of whole pictures, and meet the same voxels.
"""

from __future__ import annotations

import numpy as np

from ..octree.octree import Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import kernel, lean_device
from ..runtime.threads import run_parts
from ..runtime.vectors import LANES
from .camera import Camera, CameraUnit, camera_in_unit_cube
from .render import finer_than_pixel, seen_luminance
from .tile import BEHIND, COARSE, PICTURE, TILE, WANTED, Search, aim_tile, make_levels, make_tile, node_seen, ray_of
from .tile_walk import trace_tile


def behind_of(octree: Octree, camera: Camera, pixels: np.ndarray, *, lookahead: int = DEFAULT_LOOKAHEAD) -> np.ndarray:
    """Nodes (N,) int64 that show behind the patches of pixels (N,), -1 for none: `behind_node` of `patch_hits`."""
    unit = camera_in_unit_cube(camera, octree.grid)
    search = Search(unit.side_at_0, unit.side_per_z, 1 / finer_than_pixel(lookahead), BEHIND, octree.depth)
    return _traced(octree, unit, pixels, search, 1)[:, 0]


def fine_rays_of(
    octree: Octree,
    camera: Camera,
    pixels: np.ndarray,
    background: float = 0.0,
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
) -> np.ndarray:
    """Luminances (N, 4) float32 of 2x2 finer rays in each of the pixels (N,), as those of `fine_rays`."""
    unit = camera_in_unit_cube(camera, octree.grid)
    finer = unit.finer(finer_than_pixel(lookahead))
    search = Search(finer.side_at_0, finer.side_per_z, 1.0, COARSE, octree.depth)
    nodes = _traced(octree, unit, pixels, search, 2)
    return seen_luminance(octree, nodes.ravel(), background).reshape(nodes.shape)


def _traced(octree: Octree, unit: CameraUnit, pixels: np.ndarray, search: Search, side: int) -> np.ndarray:
    """Nodes (N, side * side) int64 that the rays of pixels (N,) end with, the lowest row first, -1 for a miss."""
    pixels = np.asarray(pixels, np.int64)
    order, starts = _blocks(pixels, unit.width_px, TILE // side)
    found = np.empty((len(pixels), side * side), np.int64)
    chosen = pixels[order], order, starts, side
    run_parts(_trace_blocks, len(starts) - 1, octree.boxed_nodes, unit, search, chosen, found)
    return found


def _blocks(pixels: np.ndarray, width_px: int, across: int) -> tuple[np.ndarray, np.ndarray]:
    """Order (N,) of pixels (N,) by blocks of across x across, and where in it each block begins and the last ends."""
    row, column = np.divmod(pixels, width_px)
    block = row // across * width_px + column // across
    order = np.argsort(block, kind="stable")
    ends = np.flatnonzero(np.diff(block[order], append=-1)) + 1
    return order, np.concatenate([np.zeros(1, np.int64), ends])


@kernel
def _trace_blocks(first, last, nodes, camera, search, chosen, found):  # type: ignore[no-untyped-def]
    """Trace blocks of a picture, each as one tile. chosen: of `_traced`."""
    pixels, places, starts, side = chosen
    scratch = make_tile(), make_levels()
    for block in range(first, last):
        begin, end = starts[block], starts[block + 1]
        _trace_block(nodes, camera, search, pixels[begin:end], side, scratch)
        _write_nodes(camera, search.last, scratch[0], pixels[begin:end], places[begin:end], side, found)


@lean_device
def _trace_block(nodes, camera, search, pixels, side, scratch):  # type: ignore[no-untyped-def]
    """Trace the rays of pixels of a block where a picture of side times its resolution has them."""
    tile, levels = scratch
    tile.lanes[WANTED, :] = 0
    for pixel in pixels:
        row, column = pixel // camera.width_px, pixel % camera.width_px
        for j in range(side):
            for i in range(side):
                ray = ray_of((side * row + j) % TILE, (side * column + i) % TILE)
                tile.numbers[PICTURE, ray] = 2.0 * (column + (i + 0.5) / side) / camera.width_px - 1.0
                tile.numbers[PICTURE + 1, ray] = 2.0 * (row + (j + 0.5) / side) / camera.height_px - 1.0
                tile.lanes[WANTED, ray // LANES] |= np.int64(1) << (ray % LANES)
    aim_tile(camera, tile)
    trace_tile(nodes, search, tile, levels)


@lean_device
def _write_nodes(camera, phase, tile, pixels, places, side, found):  # type: ignore[no-untyped-def]
    """Write what each ray of a tile has found in a phase to the places of its pixel."""
    for spot in range(len(pixels)):
        row, column = pixels[spot] // camera.width_px, pixels[spot] % camera.width_px
        for j in range(side):
            for i in range(side):
                ray = ray_of((side * row + j) % TILE, (side * column + i) % TILE)
                found[places[spot], side * j + i] = node_seen(camera, tile, phase, ray)
