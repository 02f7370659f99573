# SPDX-License-Identifier: GPL-3.0-or-later
"""First hits of the rays of a tile of 8x8 pixels, packet by packet (methods 4.1c).

Rays that are mirrored differently are walked one group after the other.
"""

from __future__ import annotations

from ..runtime.kernels import device
from .packet_walk import walk_packet
from .tile import (
    ALIVE,
    COARSE,
    MIRRORED,
    NODE,
    PACKETS,
    PHASE,
    PHASES,
    PIECE,
    TILE,
    WANTED,
    XS,
    YS,
    aim_tile,
    find_entries,
    want_pixels,
)


@device
def trace_block(nodes, camera, search, first, count, offset, scratch):
    """Trace the rays of neighbouring pixels, with their entry points; returns the number of visits.

    first: row and column of the lowest left pixel. count: rows and columns from there on; a tile takes at most 8 of
    each. offset: of the rays from the pixels' centres, (x, y) in pixels. scratch: tile and levels.
    """
    tile, levels = scratch
    (row, column), (rows, columns), (x, y) = first, count, offset
    for k in range(TILE):
        tile.numbers[XS, k] = 2.0 * (column + k + 0.5 + x) / camera.width_px - 1.0
        tile.numbers[YS, k] = 2.0 * (row + k + 0.5 + y) / camera.height_px - 1.0
    want_pixels(tile, rows, columns)
    aim_tile(camera, tile)
    visits = trace_tile(nodes, search, tile, levels)
    find_entries(tile)
    return visits


@device
def trace_tile(nodes, search, tile, levels):
    """Find first hits of a tile's rays in all phases of a `Search`; returns the number of nodes visited by packets.

    nodes: `Nodes`. tile: `Tile` with its rays set. levels: scratch.
    """
    for phase in range(PHASES):
        tile.numbers[NODE + phase] = -1.0
    tile.numbers[PIECE] = -1.0
    visits = 0
    for mirror in range(8):
        for packet in range(PACKETS):
            lanes = tile.lanes[WANTED, packet]
            for axis in range(3):
                down = tile.lanes[MIRRORED + axis, packet]
                lanes &= down if (mirror >> axis) & 1 else ~down
            tile.lanes[ALIVE, packet] = lanes
            for phase in range(PHASES):
                tile.lanes[PHASE + phase, packet] = lanes if phase == COARSE else 0
            if lanes != 0:
                visits += walk_packet(nodes, search, tile, packet, mirror, levels)
    return visits
