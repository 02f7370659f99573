# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree traversal by the rays of a tile of 8x8 pixels at once (methods 4.1, 4.1b).

Neighbouring rays hit the same nodes, so a tile descends the octree once, nearest children first. Large nodes are
tested against the whole tile: bounds of the rays' axial plane distances exclude children that no ray can hit. Leaves,
and nodes not much wider than the distance of two rays, are left to packets (`packet_walk.py`). The walk ends when all
rays are done. Rays that are mirrored differently are walked one group after the other. The order of visits changes no
distance, so hits equal those of single rays, bit for bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.kernels import device
from ..runtime.vectors import (
    LANES,
    OCTANTS,
    larger,
    largest,
    less,
    load,
    lowest_one,
    select,
    smaller,
    smallest,
    splat,
    splat_octants,
    store,
)  # fmt: skip
from .packet_walk import mirrored_children, step_down, walk_packet
from .tile import (
    ALIVE,
    AT,
    COARSE,
    HERE,
    INVERSE,
    MIRRORED,
    NODE,
    ORIGIN,
    PACKETS,
    PENDING,
    PHASE,
    PHASES,
    PIECE,
    RAYS,
    SPEED,
    START,
    TILE,
    WANTED,
    XS,
    YS,
    aim_tile,
    find_entries,
    want_pixels,
)

_WIDE = 10.0  # voxel side over distance of rays from which a node is tested for the whole tile; 5 and 20 are slower
_FAR = 1e300
_SAFE = 1e-12  # relative; bounds round differently from the rays' own distances
_UPPER_X, _UPPER_Y, _UPPER_Z = 0b10101010, 0b11001100, 0b11110000  # children in the upper half of each axis


class _AxisBounds(NamedTuple):
    """Bounds of a tile's rays along an axis: smallest and largest origin, and axial distance per unit."""

    first_origin: float
    last_origin: float
    near: float
    far: float


class _Bounds(NamedTuple):
    """Bounds of a tile's rays of equal mirroring.

    start: smallest axial distance of a ray's start. mirror: a bit per axis.
    """

    x: _AxisBounds
    y: _AxisBounds
    z: _AxisBounds
    start: float
    mirror: int


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
    """Find first hits of a tile's rays in all phases of a `Search`; returns the number of nodes visited by tile and
    packets.

    nodes: `Nodes`. tile: `Tile` with its rays set. levels: scratch.
    """
    for phase in range(PHASES):
        tile.numbers[NODE + phase] = -1.0
    tile.numbers[PIECE] = -1.0
    visits = 0
    for mirror in range(8):
        some = np.int64(0)
        for packet in range(PACKETS):
            lanes = tile.lanes[WANTED, packet]
            for axis in range(3):
                down = tile.lanes[MIRRORED + axis, packet]
                lanes &= down if (mirror >> axis) & 1 else ~down
            tile.lanes[ALIVE, packet] = lanes
            for phase in range(PHASES):
                tile.lanes[PHASE + phase, packet] = lanes if phase == COARSE else 0
            some |= lanes
        if some != 0:
            visits += _walk(nodes, search, tile, _bounds(tile, mirror), levels)
    return visits


@device
def _bounds(tile, mirror):
    """Bounds of the live rays of a tile."""
    start = _FAR
    for packet in range(PACKETS):
        first = packet * LANES
        axial = load(tile.numbers, START * RAYS + first) * load(tile.numbers, SPEED * RAYS + first)
        start = min(start, smallest(select(tile.lanes[ALIVE, packet], axial, splat(_FAR))))
    return _Bounds(_axis_bounds(tile, 0), _axis_bounds(tile, 1), _axis_bounds(tile, 2), start, mirror)


@device
def _axis_bounds(tile, axis):
    """Bounds of the live rays of a tile along an axis."""
    low, high = splat(_FAR), splat(-_FAR)
    first_origin, last_origin, near, far = low, high, low, high
    for packet in range(PACKETS):
        alive = tile.lanes[ALIVE, packet]
        first = packet * LANES
        origin = load(tile.numbers, (ORIGIN + axis) * RAYS + first)
        inverse = load(tile.numbers, (INVERSE + axis) * RAYS + first) * load(tile.numbers, SPEED * RAYS + first)
        first_origin = smaller(first_origin, select(alive, origin, low))
        last_origin = larger(last_origin, select(alive, origin, high))
        near = smaller(near, select(alive, inverse, low))
        far = larger(far, select(alive, inverse, high))
    return _AxisBounds(smallest(first_origin), largest(last_origin), smallest(near), largest(far))


@device
def _walk(nodes, search, tile, bounds, levels):
    """Walk down with all live rays of a tile; returns the number of visits."""
    level = np.int64(0)
    levels.state[0, HERE] = 0
    for axis in range(3):
        levels.state[0, AT + axis] = 0
    _open(nodes, bounds, levels, level)
    farthest = 0.0
    for octant in range(OCTANTS):
        farthest = max(farthest, levels.exits[0, octant])
    wide = _WIDE * search.apart
    if nodes.child_mask[0] == 0 or wide * (search.at_0 + search.per_z * farthest) > 1.0:
        return 1 + _walk_packets(nodes, search, tile, bounds.mirror, levels, level)
    visits = 1
    size = 1.0
    while level >= 0:
        pending = levels.state[level, PENDING]
        if pending == 0:
            level -= 1
            size *= 2.0
            continue
        octant = lowest_one(pending)
        levels.state[level, PENDING] = pending & (pending - 1)
        visits += 1
        step_down(nodes, bounds.mirror, levels, level, octant)
        pixel = search.at_0 + search.per_z * levels.exits[level, octant]
        if nodes.child_mask[levels.state[level + 1, HERE]] == 0 or 0.5 * size < wide * pixel:
            visits += _walk_packets(nodes, search, tile, bounds.mirror, levels, level + 1)
            if tile.lanes[ALIVE, 0] | tile.lanes[ALIVE, 1] | tile.lanes[ALIVE, 2] | tile.lanes[ALIVE, 3] == 0:
                break
        else:
            level += 1
            size *= 0.5
            _open(nodes, bounds, levels, level)
    return visits


@device
def _walk_packets(nodes, search, tile, mirror, levels, top):
    """Walk the subtree of the node at level `top` with each packet; returns the number of visits."""
    visits = 0
    for packet in range(PACKETS):
        if tile.lanes[ALIVE, packet] != 0:
            visits += walk_packet(nodes, search, tile, packet, mirror, levels, top)
    return visits


@device
def _open(nodes, bounds, levels, level):
    """Find the children of a level's node that rays of the tile may hit."""
    child = 0.5 / (np.int64(1) << level)
    x0, x1, x2, x3 = _plane_bounds(bounds.x, levels.state[level, AT], child)
    y0, y1, y2, y3 = _plane_bounds(bounds.y, levels.state[level, AT + 1], child)
    z0, z1, z2, z3 = _plane_bounds(bounds.z, levels.state[level, AT + 2], child)
    enter_x = select(_UPPER_X, splat_octants(x1), splat_octants(x0))
    enter_y = select(_UPPER_Y, splat_octants(y1), splat_octants(y0))
    enter_z = select(_UPPER_Z, splat_octants(z1), splat_octants(z0))
    leave_x = select(_UPPER_X, splat_octants(x3), splat_octants(x2))
    leave_y = select(_UPPER_Y, splat_octants(y3), splat_octants(y2))
    leave_z = select(_UPPER_Z, splat_octants(z3), splat_octants(z2))
    enter = larger(larger(enter_x, enter_y), larger(enter_z, splat_octants(bounds.start)))
    leave = smaller(smaller(leave_x, leave_y), leave_z)
    store(levels.exits, level * OCTANTS, leave)
    met = less(enter, leave + leave * splat_octants(_SAFE))
    levels.state[level, PENDING] = met & mirrored_children(nodes.child_mask[levels.state[level, HERE]], bounds.mirror)


@device
def _plane_bounds(bounds, cell, child):
    """Smallest axial distances of a node's lower and middle plane, largest of its middle and upper plane."""
    low, middle, high = 2 * cell * child, (2 * cell + 1) * child, (2 * cell + 2) * child
    ahead, behind, near, far = bounds
    return (
        _least(low - behind, near, far),
        _least(middle - behind, near, far),
        _most(middle - ahead, near, far),
        _most(high - ahead, near, far),
    )


@device
def _least(distance, near, far):
    return distance * (near if distance >= 0.0 else far)


@device
def _most(distance, near, far):
    return distance * (far if distance >= 0.0 else near)
