# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxels that rays of a job's cameras end in, and which of their pixels have rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.contract import fitting_level, has_lookahead
from ..octree.octree import Nodes
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..runtime.vectors import lowest_one
from ..tracing.camera import CameraUnit
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
from .ray_rows import rows_apart

# Besides the centre ray, four rays with the footprint of a patch's voxels pass through gaps of each pixel; on a track
# one of them, each frame another.
FINE_OFFSETS = ((-0.25, -0.25), (0.25, 0.25), (0.25, -0.25), (-0.25, 0.25))
_GOLDEN = 0.6180339887498949


class RayStops(NamedTuple):
    """Stops of R rays.

    cell: (R, 3) int32 of the voxel, and its level (R,) uint8. wanted: (R,) uint8, level of leaves for look-ahead there,
    0 for a miss. ahead: (R,) bool, whether there is look-ahead.
    """

    cell: np.ndarray
    level: np.ndarray
    wanted: np.ndarray
    ahead: np.ndarray


def bands_of(number: int, cameras: int, height_px: int) -> range:
    """Rows of tiles of a picture in which the rays of a job's camera are.

    number: of the camera among `cameras`. A long track has rays in a tenth of them, in each frame in others, so that no
    shot and no turn is missed, and that rays stay close together: neighbours visit the same nodes.
    """
    apart = rows_apart(cameras)
    return range(int(number * _GOLDEN % 1.0 * apart), -(-height_px // TILE), apart)


def ray_stops(
    nodes: Nodes, unit: CameraUnit, bands: range, offset: tuple[float, float], finer: int, lookahead: int
) -> RayStops:
    """Stops of the rays of rows of tiles, each as high as a tile: rows of pixels above the picture are misses.

    offset: from the pixels' centres, in pixels. finer: levels by which the rays' footprint is finer than the pixel.
    """
    count = len(bands) * TILE * unit.width_px
    stops = RayStops(
        cell=np.zeros((count, 3), np.int32),
        level=np.zeros(count, np.uint8),
        wanted=np.zeros(count, np.uint8),
        ahead=np.zeros(count, np.bool_),
    )
    run_parts(_trace_bands, len(bands), nodes, unit, (bands.start, bands.step), offset, (finer, lookahead), stops)
    return stops


@kernel
def _trace_bands(
    first: int, last: int, nodes: Nodes, camera: CameraUnit, bands: tuple[int, int], offset: tuple[float, float],
    levels_down: tuple[int, int], stops: RayStops,
) -> None:  # fmt: skip
    """Trace rows of tiles. bands: the first one's number, and the distance of the next.

    offset: from the pixels' centres, in pixels. levels_down: of the rays' footprint, and of the look-ahead.
    """
    scratch = make_tile(), make_levels()
    start, step = bands
    for band in range(first, last):
        first_row = TILE * (start + step * band)
        _trace_band(nodes, camera, first_row, offset, levels_down, scratch, stops, TILE * band * camera.width_px)


@device
def _trace_band(nodes, camera, first_row, offset, levels_down, scratch, stops, place):
    """Trace a row of tiles above a row of the picture; place: of its first ray among the stops."""
    finer, lookahead = levels_down
    tile = scratch[0]
    shrink = 1.0 / (np.int64(1) << finer)
    search = Search(shrink * camera.side_at_0, shrink * camera.side_per_z, 1.0, COARSE)
    for first_column in range(0, camera.width_px, TILE):
        columns = camera.width_px - first_column
        corner = first_row, first_column
        trace_block(nodes, camera, search, corner, (camera.height_px - first_row, columns), offset, scratch)
        for row in range(min(TILE, camera.height_px - first_row)):
            for column in range(min(TILE, columns)):
                ray = ray_of(row, column)
                node = node_seen(camera, tile, COARSE, ray)
                if node >= 0:
                    stop = place + row * camera.width_px + first_column + column
                    pixel = (
                        camera.side_at_0
                        + camera.side_per_z * tile.numbers[LENGTH + COARSE, ray] * tile.numbers[SPEED, ray]
                    )
                    stops.level[stop] = lowest_one(np.int64(tile.numbers[CELLS, ray]))
                    stops.wanted[stop] = fitting_level(pixel) + lookahead
                    stops.ahead[stop] = has_lookahead(nodes.child_mask, nodes.first_child, node, lookahead)
                    for axis in range(3):
                        stops.cell[stop, axis] = tile.numbers[CELL + axis, ray]
