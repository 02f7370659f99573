# SPDX-License-Identifier: GPL-3.0-or-later
"""Tile of 8x8 rays that walk through the octree together, in four packets with a ray in each lane of a vector.

Rays are mirrored so that they run upwards on every axis; each packet says which of its lanes are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.contract import MAX_LEVELS
from ..runtime.kernels import device, lean_device
from ..runtime.vectors import LANES, OCTANTS, larger, less, load, select, smaller, splat, square_root, store

TILE = 8  # pixels a side
RAYS = TILE * TILE
PACKETS = RAYS // LANES
EVERY_LANE = (1 << LANES) - 1
COARSE, FINE, BEHIND = 0, 1, 2  # what a ray looks for: voxels that fit its pixel, then finer ones, then those behind
PHASES = 3
_PACKET = 4  # pixels a side
_TINY = 1e-150


class Tile(NamedTuple):
    """Rays of a tile and what they have met so far; ray 16 p + 4 y + x is that of a pixel of packet p.

    origin, inverse: (3, 64) float64, in the unit cube, mirrored; inverse is 1 / direction.
    direction: (3, 64) float64, as it is. speed: (64,) axial distance per length.
    start: (64,) float64, length where the ray begins, or begins again. restart: (64,) float64, its patch's end.
    mirrored: (3, 4) int64, lanes of each packet that are mirrored on an axis.
    alive: (4,) int64, lanes that are still on their way. phase: (3, 4) int64, lanes in each phase.
    answered: (4,) int64, lanes that know what is behind their patch before they are there.
    node, t: (3, 64) float64, node that a phase ended with, -1 for a miss, and the length to it.
    cells: (64,) float64, 2^level of the voxel that fits the pixel. cell: (3, 64) float64, its mirrored cell.
    entry: (3, 64) float64, entry point in that voxel, [0, 1]^3, written by `find_entries`.
    wanted: (4,) int64, lanes of each packet that are to be traced. xs, ys: (8,) float64, picture coordinates in [-1, 1]
    of the tile's columns and rows. picture: (2, 64) float64, picture coordinates of each ray.
    """

    origin: np.ndarray
    inverse: np.ndarray
    direction: np.ndarray
    speed: np.ndarray
    start: np.ndarray
    restart: np.ndarray
    mirrored: np.ndarray
    alive: np.ndarray
    phase: np.ndarray
    answered: np.ndarray
    node: np.ndarray
    t: np.ndarray
    cells: np.ndarray
    cell: np.ndarray
    entry: np.ndarray
    wanted: np.ndarray
    xs: np.ndarray
    ys: np.ndarray
    picture: np.ndarray


class Levels(NamedTuple):
    """Nodes on the way down to the present one, by level, and which of their children are still to be visited.

    node: (MAX_LEVELS,) int64. cell: (MAX_LEVELS, 3) int64, mirrored. pending: (MAX_LEVELS,) int64, a bit per octant.
    exits: (MAX_LEVELS, 8) float64, largest axial distance at which a ray of the tile leaves a child.
    lanes: (MAX_LEVELS, 8) int64, lanes of the present packet that meet a child.
    """

    node: np.ndarray
    cell: np.ndarray
    pending: np.ndarray
    exits: np.ndarray
    lanes: np.ndarray


class Search(NamedTuple):
    """Search of a tile's rays.

    at_0, per_z: side of their pixels at axial distance z is at_0 + per_z * z. finer: side of the footprint of rays in
    the phases FINE and BEHIND over that, a power of two. last: the phase after which a ray is done. depth: of the
    octree, or a level that it does not reach.
    """

    at_0: float
    per_z: float
    finer: float
    last: int
    depth: int


@device
def make_tile():  # type: ignore[no-untyped-def]
    """Scratch for a tile."""
    return Tile(
        origin=np.empty((3, RAYS)),
        inverse=np.empty((3, RAYS)),
        direction=np.empty((3, RAYS)),
        speed=np.empty(RAYS),
        start=np.empty(RAYS),
        restart=np.empty(RAYS),
        mirrored=np.empty((3, PACKETS), np.int64),
        alive=np.empty(PACKETS, np.int64),
        phase=np.empty((PHASES, PACKETS), np.int64),
        answered=np.empty(PACKETS, np.int64),
        node=np.empty((PHASES, RAYS)),
        t=np.empty((PHASES, RAYS)),
        cells=np.empty(RAYS),
        cell=np.empty((3, RAYS)),
        entry=np.empty((3, RAYS)),
        wanted=np.empty(PACKETS, np.int64),
        xs=np.empty(TILE),
        ys=np.empty(TILE),
        picture=np.empty((2, RAYS)),
    )


@device
def make_levels():  # type: ignore[no-untyped-def]
    """Scratch for a walk."""
    return Levels(
        node=np.empty(MAX_LEVELS, np.int64),
        cell=np.empty((MAX_LEVELS, 3), np.int64),
        pending=np.empty(MAX_LEVELS, np.int64),
        exits=np.empty((MAX_LEVELS, OCTANTS)),
        lanes=np.empty((MAX_LEVELS, OCTANTS), np.int64),
    )


@lean_device
def ray_of(row, column):  # type: ignore[no-untyped-def]
    """Index in a tile of the ray of its pixel in a row and column, 0 to 7."""
    return (row >> 2) * 32 + (column >> 2) * LANES + (row & 3) * _PACKET + (column & 3)


@lean_device
def want_pixels(tile, rows, columns):  # type: ignore[no-untyped-def]
    """Set the lanes that are to be traced to the pixels in the first `rows` and `columns` of a tile."""
    for packet in range(PACKETS):
        if rows >= TILE and columns >= TILE:
            tile.wanted[packet] = EVERY_LANE
            continue
        tile.wanted[packet] = 0
        for lane in range(LANES):
            row, column = _PACKET * (packet >> 1) + (lane >> 2), _PACKET * (packet & 1) + (lane & 3)
            if row < rows and column < columns:
                tile.wanted[packet] |= np.int64(1) << lane


@lean_device
def spread_picture(tile):  # type: ignore[no-untyped-def]
    """Give each ray the picture coordinates of its column and row."""
    for packet in range(PACKETS):
        for lane in range(LANES):
            ray = packet * LANES + lane
            tile.picture[0, ray] = tile.xs[_PACKET * (packet & 1) + (lane & 3)]
            tile.picture[1, ray] = tile.ys[_PACKET * (packet >> 1) + (lane >> 2)]


@lean_device
def aim_tile(camera, tile):  # type: ignore[no-untyped-def]
    """Set the rays of a tile to those of the camera through their picture coordinates.

    Packets without a lane that is to be traced are left out.
    """
    for packet in range(PACKETS):
        if tile.wanted[packet] == 0:
            continue
        first = packet * LANES
        sx = load(tile.picture, first) + splat(camera.shift_x)
        sy = load(tile.picture, RAYS + first) + splat(camera.shift_y)
        ox, dx = _aimed(camera, sx, sy, 0)
        oy, dy = _aimed(camera, sx, sy, 1)
        oz, dz = _aimed(camera, sx, sy, 2)
        length = square_root(dx * dx + dy * dy + dz * dz)
        speed = splat(1.0) / length if camera.perspective else splat(1.0)
        store(tile.speed, first, speed)
        store(tile.start, first, splat(camera.nearest) / speed)
        _set_axis(tile, 0, packet, ox, dx / length)
        _set_axis(tile, 1, packet, oy, dy / length)
        _set_axis(tile, 2, packet, oz, dz / length)


@lean_device
def _aimed(camera, sx, sy, axis):  # type: ignore[no-untyped-def]
    """Origin and direction of a packet's rays on an axis, the direction of any length."""
    pose = camera.pose
    origin, direction = splat(pose[0, axis]), splat(pose[3, axis])
    across = sx * splat(pose[1, axis]) + sy * splat(pose[2, axis])
    if camera.perspective:
        return origin, direction + across
    return origin + across, direction


@lean_device
def _set_axis(tile, axis, packet, origin, direction):  # type: ignore[no-untyped-def]
    """Store the rays of a packet on one axis, mirrored if they run downwards."""
    first = axis * RAYS + packet * LANES
    down = less(direction, splat(0.0))
    store(tile.direction, first, direction)
    store(tile.origin, first, select(down, splat(1.0) - origin, origin))
    along = larger(select(down, splat(0.0) - direction, direction), splat(_TINY))
    store(tile.inverse, first, splat(1.0) / along)
    tile.mirrored[axis, packet] = down


@lean_device
def node_seen(camera, tile, phase, ray):  # type: ignore[no-untyped-def]
    """Node that a ray found in a phase, -1 if that is farther than the camera sees."""
    node = np.int64(tile.node[phase, ray])
    if node >= 0 and tile.t[phase, ray] * tile.speed[ray] > camera.farthest:
        return np.int64(-1)
    return node


@lean_device
def find_entries(tile):  # type: ignore[no-untyped-def]
    """Find where rays enter the voxel that stopped them, and turn its cell back to that of the octree."""
    for packet in range(PACKETS):
        if tile.wanted[packet] == 0:
            continue
        first = packet * LANES
        t, cells = load(tile.t, first), load(tile.cells, first)
        for axis in range(3):
            here = axis * RAYS + first
            down = tile.mirrored[axis, packet]
            cell, origin = load(tile.cell, here), load(tile.origin, here)
            cell = select(down, cells - splat(1.0) - cell, cell)
            origin = select(down, splat(1.0) - origin, origin)
            local = (origin + t * load(tile.direction, here)) * cells - cell
            store(tile.cell, here, cell)
            store(tile.entry, here, smaller(larger(local, splat(0.0)), splat(1.0)))
