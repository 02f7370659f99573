# SPDX-License-Identifier: GPL-3.0-or-later
"""Tile of 8x8 rays that traverse the octree together, in four packets with a ray in each vector lane.

Rays are mirrored to run upwards on every axis; each packet marks its mirrored lanes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.contract import MAX_LEVELS
from ..cells.scales import LUMINANCE_SCALE
from ..directional.node_kernels import luminance_along
from ..runtime.kernels import array_device, device
from ..runtime.vectors import LANES, larger, less, load, select, smaller, splat, square_root, store
from .camera import FORWARD, POSITION, RIGHT, UP

TILE = 8  # pixels a side
RAYS = TILE * TILE
PACKETS = RAYS // LANES
COARSE, FINE = 0, 1  # targets of a ray: voxels that fit its pixel, then finer ones
PHASES = 2
_PACKET = 4  # pixels a side
_TINY = 1e-150


class Tile(NamedTuple):
    """Rays of a tile and their hits so far; ray 16 p + 4 y + x belongs to pixel (x, y) of packet p.

    numbers: (31, 64) float64, a row for each number of a ray, as named below.
    lanes: (7, 4) int64, lanes of each packet as bits, a row for each set of them, as named below.
    Two arrays instead of one per name: each argument adds seconds of compilation in every function that takes it.
    """

    numbers: np.ndarray
    lanes: np.ndarray


# Rows of `numbers`; those of x, y and z follow each other. In the unit cube, mirrored: the origin of a ray, and 1 /
# direction. Then its unmirrored direction, axial distance per length, and the length where it starts.
ORIGIN, INVERSE, DIRECTION, SPEED, START = 0, 3, 6, 9, 10
# Hit of each phase: node, -1 for a miss, and the length to it.
NODE, LENGTH = 11, 13
# Of the voxel that fits the pixel: 2^level, its mirrored cell, and the ray's entry point, [0, 1]^3 (`find_entries`).
CELLS, CELL, ENTRY = 15, 16, 19
# Picture coordinates of the ray, [-1, 1] to the right and up; index of its pixel where a tile has rays of several, and
# of the ray among those of its pixel; picture coordinates of the tile's columns and rows.
PICTURE, PIXEL, SAMPLE, XS, YS = 22, 24, 25, 26, 27
# Piece that ended the ray in the phase COARSE, twice its index, plus one if its back was met, -1 for a voxel or a box;
# weights of the triangle's last two corners there.
PIECE, WEIGHTS = 28, 29
_NUMBERS = 31
# Rows of `lanes`: to be traced, still alive; in each phase; mirrored on each axis.
WANTED, ALIVE, PHASE, MIRRORED = 0, 1, 2, 4
_LANE_SETS = 7


# Columns of the nodes on the path to the present one, by level: the node, its mirrored cell, its children still to be
# visited as bits, and the lanes of the present packet that meet each child.
HERE, AT, PENDING, MET = 0, 1, 4, 5
_COLUMNS = 13


class Search(NamedTuple):
    """Search of a tile's rays.

    at_0, per_z: side of their pixels at axial distance z is at_0 + per_z * z. finer: scale of the footprint in the
    phase FINE, a power of two. last: the final phase of a ray.
    """

    at_0: float
    per_z: float
    finer: float
    last: int


@array_device
def make_tile():
    """Allocate a tile."""
    return Tile(np.empty((_NUMBERS, RAYS)), np.empty((_LANE_SETS, PACKETS), np.int64))


@array_device
def make_levels():
    """Allocate the levels of a walk: (MAX_LEVELS, 13) int64."""
    return np.empty((MAX_LEVELS, _COLUMNS), np.int64)


@device
def ray_of(row, column):
    """Index of the ray of a tile's pixel in a row and column, 0 to 7."""
    return (row >> 2) * 32 + (column >> 2) * LANES + (row & 3) * _PACKET + (column & 3)


@device
def want_pixels(tile, rows, columns):
    """Give each ray the picture coordinates of its column and row, and mark those in the first `rows` and `columns` of
    a tile as lanes to be traced.
    """
    for packet in range(PACKETS):
        lanes = np.int64(0)
        for lane in range(LANES):
            ray = packet * LANES + lane
            row, column = _PACKET * (packet >> 1) + (lane >> 2), _PACKET * (packet & 1) + (lane & 3)
            tile.numbers[PICTURE, ray], tile.numbers[PICTURE + 1, ray] = tile.numbers[XS, column], tile.numbers[YS, row]
            lanes |= np.int64(row < rows and column < columns) << lane
        tile.lanes[WANTED, packet] = lanes


@device
def aim_tile(camera, tile):
    """Set the rays of a tile to those of the camera through their picture coordinates.

    Packets without a lane to trace are skipped.
    """
    for packet in range(PACKETS):
        if tile.lanes[WANTED, packet] == 0:
            continue
        first = packet * LANES
        sx = load(tile.numbers, PICTURE * RAYS + first) + splat(camera.shift_x)
        sy = load(tile.numbers, (PICTURE + 1) * RAYS + first) + splat(camera.shift_y)
        ox, dx = _aimed(camera, sx, sy, 0)
        oy, dy = _aimed(camera, sx, sy, 1)
        oz, dz = _aimed(camera, sx, sy, 2)
        length = square_root(dx * dx + dy * dy + dz * dz)
        speed = splat(1.0) / length if camera.perspective else splat(1.0)
        store(tile.numbers, SPEED * RAYS + first, speed)
        store(tile.numbers, START * RAYS + first, splat(camera.nearest) / speed)
        _set_axis(tile, 0, packet, ox, dx / length)
        _set_axis(tile, 1, packet, oy, dy / length)
        _set_axis(tile, 2, packet, oz, dz / length)


@device
def _aimed(camera, sx, sy, axis):
    """Origin and direction of a packet's rays on an axis, the direction of any length."""
    pose = camera.pose
    origin, direction = splat(pose[POSITION, axis]), splat(pose[FORWARD, axis])
    across = sx * splat(pose[RIGHT, axis]) + sy * splat(pose[UP, axis])
    if camera.perspective:
        return origin, direction + across
    return origin + across, direction


@device
def _set_axis(tile, axis, packet, origin, direction):
    """Store the rays of a packet on one axis, mirrored if they run downwards."""
    first = axis * RAYS + packet * LANES
    down = less(direction, splat(0.0))
    store(tile.numbers, DIRECTION * RAYS + first, direction)
    store(tile.numbers, ORIGIN * RAYS + first, select(down, splat(1.0) - origin, origin))
    along = larger(select(down, splat(0.0) - direction, direction), splat(_TINY))
    store(tile.numbers, INVERSE * RAYS + first, splat(1.0) / along)
    tile.lanes[MIRRORED + axis, packet] = down


@device
def node_seen(camera, tile, phase, ray):
    """Node hit by a ray in a phase, -1 beyond the far clipping distance."""
    node = np.int64(tile.numbers[NODE + phase, ray])
    if node >= 0 and tile.numbers[LENGTH + phase, ray] * tile.numbers[SPEED, ray] > camera.farthest:
        return np.int64(-1)
    return node


@device
def luminance_of_ray(light, node, tile, ray):
    """Luminance in [0, 1], float32, of a node along a ray."""
    x, y, z = tile.numbers[DIRECTION, ray], tile.numbers[DIRECTION + 1, ray], tile.numbers[DIRECTION + 2, ray]
    return luminance_along(light, node, x, y, z) / np.float32(LUMINANCE_SCALE)


@device
def find_entries(tile):
    """Find the entry points of rays into the voxels that stopped them, and undo the mirroring of the cells."""
    for packet in range(PACKETS):
        if tile.lanes[WANTED, packet] == 0:
            continue
        first = packet * LANES
        t, cells = load(tile.numbers, LENGTH * RAYS + first), load(tile.numbers, CELLS * RAYS + first)
        for axis in range(3):
            here = axis * RAYS + first
            down = tile.lanes[MIRRORED + axis, packet]
            cell, origin = load(tile.numbers, CELL * RAYS + here), load(tile.numbers, ORIGIN * RAYS + here)
            cell = select(down, cells - splat(1.0) - cell, cell)
            origin = select(down, splat(1.0) - origin, origin)
            local = (origin + t * load(tile.numbers, DIRECTION * RAYS + here)) * cells - cell
            store(tile.numbers, CELL * RAYS + here, cell)
            store(tile.numbers, ENTRY * RAYS + here, smaller(larger(local, splat(0.0)), splat(1.0)))
