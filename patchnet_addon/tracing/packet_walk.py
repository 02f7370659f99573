# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk of a packet of 4x4 rays through an octree: each ray is tested by itself, all in vector lanes.

A ray enters a node at the largest of its start and of the distances of the node's three lower planes. A node that fits
the ray's pixel, or a leaf, ends the ray's phase (methods 4.1b). Depending on its phases, the ray continues to the first
voxel that fits a finer footprint (methods 3.12). A leaf with a box ends rays that hit the box; others pass it (methods
4.1d). Where rays are to end on the surface, they have to meet a piece of the leaf (methods 7.2k); such a search has the
phase COARSE alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..cells.leaf_box_kernels import mirrored_span
from ..cells.leaf_boxes import STEPS
from ..octree.pieces import NO_PIECES
from ..runtime.kernels import device
from ..runtime.vectors import (
    LANES,
    VectorType,
    count_ones,
    larger,
    largest,
    less,
    load,
    lowest_one,
    put,
    select,
    smaller,
    splat,
)  # fmt: skip
from .packet_pieces import meet_pieces
from .tile import (
    ALIVE,
    AT,
    CELL,
    CELLS,
    COARSE,
    FINE,
    HERE,
    INVERSE,
    LENGTH,
    MET,
    NODE,
    ORIGIN,
    PENDING,
    PHASE,
    RAYS,
    SPEED,
    START,
)

_FAR = 1e300
_SAFE = 1e-12  # relative


class _Planes(NamedTuple):
    """Lengths of a packet's rays to the lower, middle and upper plane of a node across an axis."""

    low: VectorType
    middle: VectorType
    high: VectorType


@device
def walk_packet(nodes, search, tile, packet, mirror, levels):
    """Walk from the root with the rays of a packet that are alive; returns the number of visited nodes.

    levels: scratch of `make_levels`.
    """
    first = packet * LANES
    for column in range(AT + 3):  # the root, and its cell
        levels[0, column] = 0
    size = 1.0
    enter, leave = _entry(tile, first, levels, 0, size), _exit(tile, first, levels, 0, size)
    lanes = tile.lanes[ALIVE, packet] & less(enter, leave)
    if lanes == 0:
        return 1
    largest_side = _largest_fitting_side(search, tile, packet, lanes, leave)
    visits = 1
    level = np.int64(-1)
    while True:
        # Rays of `lanes` hit the node at level + 1, of side `size`.
        if lanes != 0:
            if size < largest_side or nodes.child_mask[levels[level + 1, HERE]] == 0:
                lanes = _end_phases(nodes, search, tile, packet, mirror, levels, level + 1, lanes)
            if lanes != 0:
                level += 1
                size *= 0.5
                _open(nodes, tile, first, mirror, levels, level, lanes)
        alive = tile.lanes[ALIVE, packet]
        if alive == 0:
            break
        while level >= 0 and levels[level, PENDING] == 0:
            level -= 1
            size *= 2.0
        if level < 0:
            break
        pending = levels[level, PENDING]
        octant = lowest_one(pending)
        levels[level, PENDING] = pending & (pending - 1)
        lanes = levels[level, MET + octant] & alive
        if lanes != 0:
            visits += 1
            _step_down(nodes, mirror, levels, level, octant)
    return visits


@device
def _largest_fitting_side(search, tile, packet, lanes, leave):
    """Node side from which no ray fits, for nodes entered before the lengths `leave`; with a margin for rounding."""
    speed = load(tile.numbers, SPEED * RAYS + packet * LANES)
    farthest = largest(select(lanes, leave * speed, splat(-_FAR)))
    return 2.0 * (search.at_0 + search.per_z * farthest) * (1.0 + _SAFE)


@device
def _step_down(nodes, mirror, levels, level, octant):
    """Write the child of a level's node at a mirrored octant into the next level."""
    node = levels[level, HERE]
    below = (np.int64(1) << (octant ^ mirror)) - 1
    levels[level + 1, HERE] = np.int64(nodes.first_child[node]) + count_ones(np.int64(nodes.child_mask[node]) & below)
    for axis in range(3):
        levels[level + 1, AT + axis] = 2 * levels[level, AT + axis] + ((octant >> axis) & 1)


@device
def _mirrored_children(mask, mirror):
    """Child mask in mirrored coordinates."""
    mask = np.int64(mask)
    if mirror & 1:
        mask = (mask & 0x55) << 1 | (mask >> 1) & 0x55
    if mirror & 2:
        mask = (mask & 0x33) << 2 | (mask >> 2) & 0x33
    if mirror & 4:
        mask = (mask & 0x0F) << 4 | mask >> 4
    return mask


@device
def _to_plane(tile, axis, first, plane):
    """Lengths of a packet's rays to a plane across an axis."""
    origin = load(tile.numbers, (ORIGIN + axis) * RAYS + first)
    return (splat(plane) - origin) * load(tile.numbers, (INVERSE + axis) * RAYS + first)


@device
def _entry(tile, first, levels, level, size):
    """Lengths at which a packet's rays enter the node of a level."""
    x = _to_plane(tile, 0, first, levels[level, AT] * size)
    y = _to_plane(tile, 1, first, levels[level, AT + 1] * size)
    z = _to_plane(tile, 2, first, levels[level, AT + 2] * size)
    return larger(larger(x, y), larger(z, load(tile.numbers, START * RAYS + first)))


@device
def _exit(tile, first, levels, level, size):
    """Lengths at which a packet's rays leave the node of a level."""
    x = _to_plane(tile, 0, first, (levels[level, AT] + 1) * size)
    y = _to_plane(tile, 1, first, (levels[level, AT + 1] + 1) * size)
    z = _to_plane(tile, 2, first, (levels[level, AT + 2] + 1) * size)
    return smaller(smaller(x, y), z)


@device
def _box_span(nodes, tile, first, mirror, levels, level):
    """Lengths at which a packet's rays enter and leave the box of a level's node; the node must have one."""
    box = nodes.boxes[levels[level, HERE] - nodes.first_boxed]
    step = 1.0 / (STEPS * (np.int64(1) << level))
    near_x, far_x = _box_planes(tile, 0, first, levels[level, AT], step, mirrored_span(box[0], mirror & 1))
    near_y, far_y = _box_planes(tile, 1, first, levels[level, AT + 1], step, mirrored_span(box[1], mirror & 2))
    near_z, far_z = _box_planes(tile, 2, first, levels[level, AT + 2], step, mirrored_span(box[2], mirror & 4))
    enter = larger(larger(near_x, near_y), larger(near_z, load(tile.numbers, START * RAYS + first)))
    return enter, smaller(smaller(far_x, far_y), far_z)


@device
def _box_planes(tile, axis, first, cell, step, span):
    """Lengths of a packet's rays to both planes of a box across an axis; span: its first and last step in the cell."""
    low, high = (STEPS * cell + span[0]) * step, (STEPS * cell + span[1] + 1) * step
    return _to_plane(tile, axis, first, low), _to_plane(tile, axis, first, high)


@device
def _has_pieces(nodes, node):
    """Return whether a node is a leaf with pieces, and rays are to meet these."""
    if len(nodes.pieces) == 0 or nodes.child_mask[node] != 0:
        return False
    return nodes.first_child[node] != NO_PIECES


@device
def _end_phases(nodes, search, tile, packet, mirror, levels, level, lanes):
    """End the phases of rays among `lanes` that the node of a level stops; returns lanes that continue inside it."""
    first = packet * LANES
    size = 1.0 / (np.int64(1) << level)
    leaf = nodes.child_mask[levels[level, HERE]] == 0
    boxed = levels[level, HERE] >= nodes.first_boxed
    tested = lanes
    while tested != 0:
        enter, leave = _entry(tile, first, levels, level, size), splat(_FAR)
        stopped = tested
        if boxed:
            enter, leave = _box_span(nodes, tile, first, mirror, levels, level)
            stopped &= less(enter, leave)
        if leaf and _has_pieces(nodes, levels[level, HERE]):
            if not boxed:
                leave = _exit(tile, first, levels, level, size)
            here = levels[level, HERE]
            stopped, enter = meet_pieces(nodes, tile, packet, mirror, here, size, (stopped, enter, leave))
        if not leaf:
            stopped &= less(splat(size), splat(2.0) * _pixel_side(search, tile, packet, enter))
        tested = np.int64(0)
        for phase in range(FINE, -1, -1):  # in reverse, so that a phase does not begin and end here
            ended = stopped & tile.lanes[PHASE + phase, packet]
            if ended != 0:
                _record(tile, packet, phase, levels, level, ended, enter)
                tested |= _begin_next(search, tile, packet, phase, ended)
    return np.int64(0) if leaf else lanes & tile.lanes[ALIVE, packet]


@device
def _pixel_side(search, tile, packet, length):
    """Pixel sides, or sides of the finer footprint, of a packet's rays at a length."""
    pixel = splat(search.at_0) + splat(search.per_z) * (length * load(tile.numbers, SPEED * RAYS + packet * LANES))
    if search.last == COARSE:
        return pixel
    return pixel * select(tile.lanes[PHASE + COARSE, packet], splat(1.0), splat(search.finer))


@device
def _record(tile, packet, phase, levels, level, ended, enter):
    """Record the node of a level as the hit of a phase."""
    first = packet * LANES
    here = phase * RAYS + first
    put(tile.numbers, LENGTH * RAYS + here, ended, enter)
    put(tile.numbers, NODE * RAYS + here, ended, splat(np.float64(levels[level, HERE])))
    if phase == COARSE:
        _put_cell(tile, first, ended, levels, level)


@device
def _put_cell(tile, first, lanes, levels, level):
    """Store the voxel that stopped some rays of a packet: cells of its level a side, and its own."""
    put(tile.numbers, CELLS * RAYS + first, lanes, splat(np.float64(np.int64(1) << level)))
    for axis in range(3):
        put(tile.numbers, (CELL + axis) * RAYS + first, lanes, splat(np.float64(levels[level, AT + axis])))


@device
def _begin_next(search, tile, packet, phase, ended):
    """Begin the next phase of lanes whose phase ended; returns those that are not done."""
    tile.lanes[PHASE + phase, packet] &= ~ended
    if phase >= search.last:
        tile.lanes[ALIVE, packet] &= ~ended
        return np.int64(0)
    tile.lanes[PHASE + FINE, packet] |= ended
    return ended


@device
def _open(nodes, tile, first, mirror, levels, level, lanes):
    """Find the children of a level's node hit by each ray among `lanes`."""
    x, y, z = _child_planes(tile, first, levels, level)
    existing = _mirrored_children(nodes.child_mask[levels[level, HERE]], mirror)
    found = levels[level]
    pending = np.int64(0)
    if existing & 0x03:
        pending |= _open_pair(found, existing, 0, lanes, x, larger(y.low, z.low), smaller(y.middle, z.middle))
    if existing & 0x0C:
        pending |= _open_pair(found, existing, 2, lanes, x, larger(y.middle, z.low), smaller(y.high, z.middle))
    if existing & 0x30:
        pending |= _open_pair(found, existing, 4, lanes, x, larger(y.low, z.middle), smaller(y.middle, z.high))
    if existing & 0xC0:
        pending |= _open_pair(found, existing, 6, lanes, x, larger(y.middle, z.middle), smaller(y.high, z.high))
    levels[level, PENDING] = pending


@device
def _child_planes(tile, first, levels, level):
    """Planes of a level's children: along x lengths at which rays enter the lower and upper one, and leave them."""
    child = 0.5 / (np.int64(1) << level)
    start = load(tile.numbers, START * RAYS + first)
    x = _three_planes(tile, 0, first, 2 * levels[level, AT], child)
    y = _three_planes(tile, 1, first, 2 * levels[level, AT + 1], child)
    z = _three_planes(tile, 2, first, 2 * levels[level, AT + 2], child)
    return ((larger(x.low, start), larger(x.middle, start)), (x.middle, x.high)), y, z


@device
def _three_planes(tile, axis, first, cell, child):
    """Lengths to the lower, middle and upper plane of a node whose first child has this cell."""
    low, middle = _to_plane(tile, axis, first, cell * child), _to_plane(tile, axis, first, (cell + 1) * child)
    return _Planes(low, middle, _to_plane(tile, axis, first, (cell + 2) * child))


@device
def _open_pair(found, existing, octant, lanes, along, enter, leave):
    """Write the lanes that hit an octant and its neighbour along x; returns the bits of the octants hit by any lane.

    along: of `_child_planes`.
    """
    enter_along, leave_along = along
    pending = np.int64(0)
    if (existing >> octant) & 1:
        met = lanes & less(larger(enter_along[0], enter), smaller(leave_along[0], leave))
        found[MET + octant] = met
        if met != 0:
            pending |= np.int64(1) << octant
    if (existing >> (octant + 1)) & 1:
        met = lanes & less(larger(enter_along[1], enter), smaller(leave_along[1], leave))
        found[MET + octant + 1] = met
        if met != 0:
            pending |= np.int64(1) << (octant + 1)
    return pending
