# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of an octree: first hits, and the finer voxels of the same rays (methods 3.12, 4.1b).

All pictures are (H * W,) with row 0 at the bottom, as Blender stores them.
"""

from __future__ import annotations

import numpy as np

from ..cells.contract import pixel_voxel_ratio
from ..cells.scales import LUMINANCE_SCALE
from ..directional.node_kernels import see_colors, see_luminance
from ..octree.octree import Nodes, Octree
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..runtime.vectors import lowest_one
from .camera import Camera, CameraUnit, camera_in_unit_cube
from .hits import Hits
from .tile import (
    CELL,
    CELLS,
    COARSE,
    DIRECTION,
    ENTRY,
    FINE,
    LENGTH,
    SPEED,
    TILE,
    Search,
    make_levels,
    make_tile,
    node_seen,
    ray_of,
)
from .tile_walk import trace_block

_PATCH_SIDES = 1.5  # voxel sides from the entry to the end of the patch


def finer_than_pixel(lookahead: int) -> float:
    """Side of a pixel over the footprint of finer rays.

    They reach one level deeper than a patch that looks `lookahead` levels ahead (methods 3.12), so that bars and wires
    that fill a voxel of the patch keep their real width.
    """
    return 2.0 ** (lookahead + 1)


def first_hits(octree: Octree, camera: Camera) -> Hits:
    """Trace a ray through every pixel centre, stopped by the level-of-detail contract."""
    return _lit(octree, trace_pixels(octree, camera)[0])


def fine_hits(octree: Octree, camera: Camera, *, lookahead: int = DEFAULT_LOOKAHEAD) -> tuple[Hits, np.ndarray]:
    """Trace a ray through every pixel centre, and on to the first voxel that fits a finer footprint, in one walk.

    The finer footprint is the pixel over `finer_than_pixel`. Returns the hits, and the luminance (P,) float32 of the
    finer voxels, 0 for a miss.
    """
    unit = camera_in_unit_cube(camera, octree.grid)
    search = Search(unit.side_at_0, unit.side_per_z, 1 / finer_than_pixel(lookahead), FINE)
    hits, fine, _ = trace_pixels(octree, camera, search)
    return _lit(octree, hits), seen_luminance(octree, fine, hits.direction)


def visits_per_ray(octree: Octree, camera: Camera) -> float:
    """Nodes visited by tiles and packets in `first_hits` per ray; equal on every machine."""
    return float(trace_pixels(octree, camera)[2].sum() / camera.pixel_count)


def trace_pixels(
    octree: Octree, camera: Camera, search: Search | None = None, nodes: Nodes | None = None
) -> tuple[Hits, np.ndarray, np.ndarray]:
    """Hits of all pixels, still without luminance; nodes that finer rays hit; visits by row of tiles (rows,) int64.

    These nodes are (P,) int64, -1 for none, or (0,) if the search does not ask for them.

    search: None as `first_hits`. nodes: `Octree.exact_nodes` for rays that end on the surface; None: on boxes.
    """
    unit = camera_in_unit_cube(camera, octree.grid)
    if search is None:
        search = Search(unit.side_at_0, unit.side_per_z, 1.0, COARSE)
    pixels = camera.pixel_count
    hits = Hits(
        width_px=camera.width_px,
        height_px=camera.height_px,
        node=np.empty(pixels, np.int64),
        level=np.empty(pixels, np.int32),
        cell=np.empty((pixels, 3), np.int32),
        t_world=np.empty(pixels, np.float32),
        z_world=np.empty(pixels, np.float32),
        ratio=np.empty(pixels, np.float32),
        entry_voxel=np.empty((pixels, 3), np.float32),
        direction=np.empty((pixels, 3), np.float32),
        patch_end=np.empty(pixels),
        camera_up=np.array(camera.up, np.float64),
        luminance=np.empty(0, np.float32),
    )
    fine = np.empty(pixels if search.last >= FINE else 0, np.int64)
    visits = np.zeros(-(-camera.height_px // TILE), np.int64)
    traced = hits, fine
    run_parts(_trace_rows, len(visits), octree.nodes if nodes is None else nodes, unit, search, traced, visits)
    return hits, fine, visits


def _lit(octree: Octree, hits: Hits) -> Hits:
    return hits._replace(luminance=seen_luminance(octree, hits.node, hits.direction))


def seen_luminance(octree: Octree, nodes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Luminance (P,) float32 of nodes (P,) along directions (P, 3) float32, 0 for -1 (no node)."""
    seen = np.empty(len(nodes), np.float32)
    run_parts(see_luminance, len(nodes), octree.light, nodes, directions, seen)
    return seen


def seen_color(octree: Octree, nodes: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Linear colours (P, 3) float32 of nodes (P,) along directions (P, 3), 0 for -1 (no node).

    They are gray without colour.
    """
    if octree.chroma is None:
        return np.repeat(seen_luminance(octree, nodes, directions)[:, None], 3, axis=1)
    colors = np.zeros((len(nodes), 3), np.float32)
    met = nodes >= 0
    colors[met] = octree.color_float(nodes[met])
    run_parts(see_colors, len(nodes), octree.light.sides, nodes, directions, colors)
    return colors


def seen_above_white(octree: Octree, hits: Hits) -> np.ndarray:
    """Linear colours (P, 3) float32 above white of the hit nodes, scaled by the brightness of the visible side."""
    above = octree.color_above_white(hits.node)
    bright = np.flatnonzero(above.any(axis=1))
    if octree.side_nodes is not None and len(bright):
        mean = np.maximum(octree.luminance_float(hits.node[bright]), np.float32(1.0 / LUMINANCE_SCALE))
        above[bright] *= (hits.luminance[bright] / mean)[:, None]
    return above


@kernel
def _trace_rows(
    first: int, last: int, nodes: Nodes, camera: CameraUnit, search: Search, traced: tuple[Hits, np.ndarray],
    visits: np.ndarray,
) -> None:  # fmt: skip
    """Trace rows of tiles; writes the number of visits of each."""
    scratch = make_tile(), make_levels()
    for row in range(first, last):
        visits[row] = _trace_row(nodes, camera, search, row * TILE, scratch, traced)


@device
def _trace_row(nodes, camera, search, first_row, scratch, traced):
    """Trace the tiles whose first row of pixels is `first_row` into `traced`; returns the number of visits."""
    rows = min(TILE, camera.height_px - first_row)
    visits = 0
    for first_column in range(0, camera.width_px, TILE):
        columns = min(TILE, camera.width_px - first_column)
        corner = first_row, first_column
        visits += trace_block(nodes, camera, search, corner, (rows, columns), (0.0, 0.0), scratch)
        for row in range(rows):
            for column in range(columns):
                pixel = (first_row + row) * camera.width_px + first_column + column
                _write(camera, search, scratch[0], ray_of(row, column), traced, pixel)
    return visits


@device
def _write(camera, search, tile, ray, traced, pixel):
    """Write the hits of a ray of a tile into `traced`."""
    hits, fine = traced
    node = node_seen(camera, tile, COARSE, ray)
    hits.node[pixel] = node
    for axis in range(3):
        hits.direction[pixel, axis] = tile.numbers[DIRECTION + axis, ray]
    if search.last >= FINE:
        fine[pixel] = node_seen(camera, tile, FINE, ray)
    if node < 0:
        hits.level[pixel] = 0
        hits.ratio[pixel] = 1.0
        hits.t_world[pixel] = np.inf
        hits.z_world[pixel] = np.inf
        hits.patch_end[pixel] = np.inf
        for axis in range(3):
            hits.cell[pixel, axis] = -1
            hits.entry_voxel[pixel, axis] = 0.0
        return
    t, cells = tile.numbers[LENGTH + COARSE, ray], tile.numbers[CELLS, ray]
    z = t * tile.numbers[SPEED, ray]
    hits.level[pixel] = lowest_one(np.int64(cells))
    hits.ratio[pixel] = pixel_voxel_ratio(camera.side_at_0 + camera.side_per_z * z, cells)
    hits.t_world[pixel] = t * camera.side_world
    hits.z_world[pixel] = z * camera.side_world
    hits.patch_end[pixel] = t + _PATCH_SIDES / cells
    for axis in range(3):
        hits.cell[pixel, axis] = tile.numbers[CELL + axis, ray]
        hits.entry_voxel[pixel, axis] = tile.numbers[ENTRY + axis, ray]
