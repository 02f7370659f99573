# SPDX-License-Identifier: GPL-3.0-or-later
"""Level of detail of a picture, block by block, for look-ahead in all pixels (methods 4.1b)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.contract import MAX_LEVELS, fitting_level, has_lookahead
from ..cells.morton_kernels import cell_key
from ..octree.grid import Grid
from ..octree.nodes import Nodes, without_boxes
from ..runtime.bits import lowest_one
from ..runtime.bounds import DEFAULT_LOOKAHEAD
from ..runtime.kernels import kernel, lean_device
from ..runtime.progress import Progress, Steps
from ..runtime.threads import run_parts
from ..tracing.camera import Camera, CameraUnit, camera_in_unit_cube
from ..tracing.tile import (
    CELL,
    CELLS,
    COARSE,
    LENGTH,
    SPEED,
    TILE,
    Search,
    make_levels,
    make_tile,
    node_seen,
    ray_of,
)
from ..tracing.tile_walk import trace_block

_ROWS_PER_STEP = 64
# Besides the centre ray, four rays with the footprint of a patch's voxels pass through gaps of each pixel.
FINE_OFFSETS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


class _Stops(NamedTuple):
    """Stops of R rays.

    cell: (R, 3) int32 of the voxel, and its level (R,) uint8. wanted: (R,) uint8, level of leaves for look-ahead there,
    0 for a miss. ahead: (R,) bool, whether there is look-ahead.
    """

    cell: np.ndarray
    level: np.ndarray
    wanted: np.ndarray
    ahead: np.ndarray


def needed_levels(
    nodes: Nodes,
    grid: Grid,
    camera: Camera,
    needed: np.ndarray,
    pixels: np.ndarray,
    *,
    lookahead: int = DEFAULT_LOOKAHEAD,
    coarser: int = 0,
) -> Steps[None]:
    """Raise `needed` (8^b,) uint8, by block of level b, to the level of leaves for look-ahead where rays hit.

    pixels: (8^b,) uint32, increased by the number of pixels whose centre ray stops in each block.

    nodes: of the present octree. lookahead: levels, of the weights in use. A pixel's centre ray requests the level for
    the voxel that stops it and for its neighbours, which are in its patches; rays with the footprint of the patch's
    voxels request it for their own hits, and so for surface in the gaps of the coarse picture. coarser: levels by which
    the camera's pixels are coarser than those with look-ahead, whose footprints rays have.
    """
    unit = camera_in_unit_cube(camera, grid)
    block_level = (len(needed).bit_length() - 1) // 3
    for first in range(0, camera.height_px, _ROWS_PER_STEP):
        last = min(first + _ROWS_PER_STEP, camera.height_px)
        for offset, levels, margin in [((0.0, 0.0), 0, 1), *((offset, lookahead, 0) for offset in FINE_OFFSETS)]:
            stops = _stops(nodes, unit, (first, last), offset, levels + coarser, lookahead + coarser)
            _request(stops, margin, block_level, needed)
            if margin:
                _count(stops, block_level, pixels)
        yield Progress(last, camera.height_px, "Finding detail")


def lookahead_share(nodes: Nodes, grid: Grid, camera: Camera, *, lookahead: int = DEFAULT_LOOKAHEAD) -> float:
    """Share of the pixels that hit the octree whose voxel has descendants `lookahead` levels down; 1 without hits."""
    stops = _stops(nodes, camera_in_unit_cube(camera, grid), (0, camera.height_px), (0.0, 0.0), 0, lookahead)
    return float(stops.ahead[stops.wanted > 0].mean()) if (stops.wanted > 0).any() else 1.0


def _stops(
    nodes: Nodes, unit: CameraUnit, rows: tuple[int, int], offset: tuple[float, float], finer: int, lookahead: int
) -> _Stops:
    """Stops of the rays of rows of pixels.

    offset: from the pixels' centres, in pixels. finer: levels by which the rays' footprint is finer than the pixel.
    """
    count = (rows[1] - rows[0]) * unit.width_px
    stops = _Stops(
        cell=np.zeros((count, 3), np.int32),
        level=np.zeros(count, np.uint8),
        wanted=np.zeros(count, np.uint8),
        ahead=np.zeros(count, np.bool_),
    )
    bands = -(-(rows[1] - rows[0]) // TILE)
    run_parts(_trace_bands, bands, without_boxes(*nodes), unit, rows[0], offset, (finer, lookahead), stops)
    return stops


@kernel
def _trace_bands(first, last, nodes, camera, first_row, offset, levels_down, stops):  # type: ignore[no-untyped-def]
    """Trace rows of tiles below a row of the picture.

    offset: from the pixels' centres, in pixels. levels_down: of the rays' footprint, and of the look-ahead.
    """
    scratch = make_tile(), make_levels()
    rows = len(stops.wanted) // camera.width_px
    for band in range(first, last):
        _trace_band(nodes, camera, (first_row, band * TILE, rows), offset, levels_down, scratch, stops)


@lean_device
def _trace_band(nodes, camera, rows, offset, levels_down, scratch, stops):  # type: ignore[no-untyped-def]
    """Trace a row of tiles; rows: the first of the picture, the band's first after that one, and their number."""
    first_row, first, count = rows
    finer, lookahead = levels_down
    tile = scratch[0]
    shrink = 1.0 / (np.int64(1) << finer)
    search = Search(shrink * camera.side_at_0, shrink * camera.side_per_z, 1.0, COARSE, MAX_LEVELS)
    for first_column in range(0, camera.width_px, TILE):
        columns = camera.width_px - first_column
        corner = first_row + first, first_column
        trace_block(nodes, camera, search, corner, (count - first, columns), offset, scratch)
        for row in range(min(TILE, count - first)):
            for column in range(min(TILE, columns)):
                ray = ray_of(row, column)
                node = node_seen(camera, tile, COARSE, ray)
                if node >= 0:
                    stop = (first + row) * camera.width_px + first_column + column
                    pixel = (
                        camera.side_at_0
                        + camera.side_per_z * tile.numbers[LENGTH + COARSE, ray] * tile.numbers[SPEED, ray]
                    )
                    stops.level[stop] = lowest_one(np.int64(tile.numbers[CELLS, ray]))
                    stops.wanted[stop] = fitting_level(pixel) + lookahead
                    stops.ahead[stop] = has_lookahead(nodes.child_mask, nodes.first_child, node, lookahead)
                    for axis in range(3):
                        stops.cell[stop, axis] = tile.numbers[CELL + axis, ray]


@kernel
def _request(stops, margin, block_level, needed):  # type: ignore[no-untyped-def]
    """Raise `needed` in all blocks that a cell meets, or one of those `margin` cells around it."""
    blocks = np.int64(1) << block_level
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for ray in range(len(stops.wanted)):
        if stops.wanted[ray] <= block_level:  # a miss, or the coarsest leaves suffice
            continue
        deeper = np.int64(stops.level[ray]) - block_level
        for axis in range(3):
            first = np.int64(stops.cell[ray, axis]) - margin
            last = np.int64(stops.cell[ray, axis]) + margin
            if deeper >= 0:
                first, last = first >> deeper, last >> deeper
            else:
                first, last = first << -deeper, ((last + 1) << -deeper) - 1
            low[axis] = max(first, 0)
            high[axis] = min(last, blocks - 1)
        for z in range(low[2], high[2] + 1):
            for y in range(low[1], high[1] + 1):
                for x in range(low[0], high[0] + 1):
                    block = cell_key(x, y, z)
                    needed[block] = max(needed[block], stops.wanted[ray])


@kernel
def _count(stops, block_level, pixels):  # type: ignore[no-untyped-def]
    """Add one to the block of each cell; a cell larger than a block counts in its first one."""
    for ray in range(len(stops.wanted)):
        if stops.wanted[ray] == 0:
            continue
        deeper = np.int64(stops.level[ray]) - block_level
        x, y, z = np.int64(stops.cell[ray, 0]), np.int64(stops.cell[ray, 1]), np.int64(stops.cell[ray, 2])
        if deeper >= 0:
            block = cell_key(x >> deeper, y >> deeper, z >> deeper)
        else:
            block = cell_key(x, y, z) << np.uint64(-3 * deeper)
        pixels[block] += np.uint32(1)
