# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk of a packet of 4x4 rays through the subtree of one node: each ray is tested on its own, all at once.

A ray enters a node at the largest of its start and of the distances of the node's three lower planes. A node that fits
the ray's pixel, or a leaf, ends the ray's phase (methods 4.1b). A ray that looks for more goes on from there: to the
first voxel that fits a finer footprint, then to the first one behind its patch (methods 3.12).
"""

from __future__ import annotations

import numpy as np

from ..runtime.kernels import lean_device
from ..runtime.vectors import LANES, bit_count, first_bit, larger, less, load, select, smaller, splat, store
from .tile import BEHIND, COARSE, FINE, RAYS

PATCH_SIDES = 1.5  # of the voxel that fits the pixel, from its entry on: where sight behind the patch begins


@lean_device
def walk_packet(nodes, search, tile, packet, mirror, levels, top):  # type: ignore[no-untyped-def]
    """Walk the subtree of the node at level `top` with the rays of a packet that are alive; returns visited nodes."""
    first = packet * LANES
    size = 1.0 / (np.int64(1) << top)
    lanes = tile.alive[packet] & less(
        _entry(tile, first, levels, top, size), _exit(tile, first, levels, top, size)
    )
    visits = 1
    level = top - 1
    while True:
        # The node at level + 1, of side `size`, is met by `lanes`.
        if lanes != 0:
            lanes = _end_phases(nodes, search, tile, packet, levels, level + 1, lanes)
            if lanes != 0:
                level += 1
                size *= 0.5
                _open(nodes, tile, first, mirror, levels, level, lanes)
        alive = tile.alive[packet]
        if alive == 0:
            break
        while level >= top and levels.pending[level] == 0:
            level -= 1
            size *= 2.0
        if level < top:
            break
        pending = levels.pending[level]
        octant = first_bit(pending)
        levels.pending[level] = pending & (pending - 1)
        lanes = levels.lanes[level, octant] & alive
        if lanes != 0:
            visits += 1
            step_down(nodes, mirror, levels, level, octant)
    return visits


@lean_device
def step_down(nodes, mirror, levels, level, octant):  # type: ignore[no-untyped-def]
    """Write the child of a level's node at a mirrored octant into the next level."""
    node = levels.node[level]
    below = (np.int64(1) << (octant ^ mirror)) - 1
    levels.node[level + 1] = np.int64(nodes.first_child[node]) + bit_count(np.int64(nodes.child_mask[node]) & below)
    for axis in range(3):
        levels.cell[level + 1, axis] = 2 * levels.cell[level, axis] + ((octant >> axis) & 1)


@lean_device
def mirrored_children(mask, mirror):  # type: ignore[no-untyped-def]
    """Child mask in mirrored coordinates."""
    mask = np.int64(mask)
    if mirror & 1:
        mask = (mask & 0x55) << 1 | (mask >> 1) & 0x55
    if mirror & 2:
        mask = (mask & 0x33) << 2 | (mask >> 2) & 0x33
    if mirror & 4:
        mask = (mask & 0x0F) << 4 | mask >> 4
    return mask


@lean_device
def _to_plane(tile, axis, first, plane):  # type: ignore[no-untyped-def]
    """Lengths of a packet's rays to a plane across an axis."""
    origin = load(tile.origin, axis * RAYS + first)
    return (splat(plane) - origin) * load(tile.inverse, axis * RAYS + first)


@lean_device
def _entry(tile, first, levels, level, size):  # type: ignore[no-untyped-def]
    """Lengths at which a packet's rays enter the node of a level."""
    x = _to_plane(tile, 0, first, levels.cell[level, 0] * size)
    y = _to_plane(tile, 1, first, levels.cell[level, 1] * size)
    z = _to_plane(tile, 2, first, levels.cell[level, 2] * size)
    return larger(larger(x, y), larger(z, load(tile.start, first)))


@lean_device
def _exit(tile, first, levels, level, size):  # type: ignore[no-untyped-def]
    """Lengths at which a packet's rays leave the node of a level."""
    x = _to_plane(tile, 0, first, (levels.cell[level, 0] + 1) * size)
    y = _to_plane(tile, 1, first, (levels.cell[level, 1] + 1) * size)
    z = _to_plane(tile, 2, first, (levels.cell[level, 2] + 1) * size)
    return smaller(smaller(x, y), z)


@lean_device
def _end_phases(nodes, search, tile, packet, levels, level, lanes):  # type: ignore[no-untyped-def]
    """End the phases of rays among `lanes` that the node of a level stops; returns the lanes that go on inside it."""
    first = packet * LANES
    size = 1.0 / (np.int64(1) << level)
    leaf = nodes.child_mask[levels.node[level]] == 0
    tested = lanes
    while tested != 0:
        enter = _entry(tile, first, levels, level, size)
        stopped = tested
        behind = tested & tile.phase[BEHIND, packet]
        if behind != 0:  # these may begin beyond the node
            stopped &= less(enter, _exit(tile, first, levels, level, size)) | ~behind
        if not leaf:
            stopped &= less(splat(size), splat(2.0) * _pixel_side(search, tile, packet, enter))
        tested = np.int64(0)
        for phase in range(BEHIND, -1, -1):  # the last first, so that a phase that begins does not end with the others
            ended = stopped & tile.phase[phase, packet]
            if ended != 0:
                _record(tile, packet, phase, levels, level, ended, enter)
                tested |= _begin_next(search, tile, packet, phase, level, ended)
        begun = tested & tile.phase[BEHIND, packet]
        if begun != 0:
            _fit_ancestors(search, tile, packet, levels, level, begun)
            tested &= tile.alive[packet]
    return np.int64(0) if leaf else lanes & tile.alive[packet]


@lean_device
def _pixel_side(search, tile, packet, length):  # type: ignore[no-untyped-def]
    """Sides of the pixels, or of what is finer, of a packet's rays at a length."""
    pixel = splat(search.at_0) + splat(search.per_z) * (length * load(tile.speed, packet * LANES))
    if search.last == COARSE:
        return pixel
    return pixel * select(tile.phase[COARSE, packet], splat(1.0), splat(search.finer))


@lean_device
def _record(tile, packet, phase, levels, level, ended, enter):  # type: ignore[no-untyped-def]
    """Record the node of a level as what rays found in a phase."""
    first = packet * LANES
    here = phase * RAYS + first
    store(tile.t, here, select(ended, enter, load(tile.t, here)))
    left = ended
    while left != 0:
        ray = first + first_bit(left)
        left &= left - 1
        tile.node[phase, ray] = levels.node[level]
        tile.level[phase, ray] = level
        if phase == COARSE:
            for axis in range(3):
                tile.cell[ray, axis] = levels.cell[level, axis]


@lean_device
def _begin_next(search, tile, packet, phase, level, ended):  # type: ignore[no-untyped-def]
    """Begin the phase after that which ended for some lanes; returns them, or no lanes if they are done."""
    first = packet * LANES
    tile.phase[phase, packet] &= ~ended
    if phase >= search.last:
        tile.alive[packet] &= ~ended
        return np.int64(0)
    if phase == COARSE:
        beyond = load(tile.t, first) + splat(PATCH_SIDES / (np.int64(1) << level))
        store(tile.restart, first, select(ended, beyond, load(tile.restart, first)))
        tile.phase[FINE, packet] |= ended
    else:
        tile.phase[BEHIND, packet] |= ended
        store(tile.start, first, select(ended, load(tile.restart, first), load(tile.start, first)))
    return ended


@lean_device
def _fit_ancestors(search, tile, packet, levels, level, begun):  # type: ignore[no-untyped-def]
    """Stop rays that begin again behind their patch at the coarsest node on the way down that fits them there.

    Pixels grow with the distance, so a node that was too large where the ray entered it may fit where it begins again.
    """
    first = packet * LANES
    parent = 2.0 / (np.int64(1) << level)
    pixel = _pixel_side(search, tile, packet, load(tile.start, first))
    larger_ones = begun & less(splat(parent), splat(2.0) * pixel)
    above = np.int64(0)
    while larger_ones != 0 and above < level:
        size = 1.0 / (np.int64(1) << above)
        fits = larger_ones & less(splat(size), splat(2.0) * pixel)
        if fits != 0:
            enter = _entry(tile, first, levels, above, size)
            fits &= less(enter, _exit(tile, first, levels, above, size))
            if fits != 0:
                _record(tile, packet, BEHIND, levels, above, fits, enter)
                tile.phase[BEHIND, packet] &= ~fits
                tile.alive[packet] &= ~fits
                larger_ones &= ~fits
        above += 1


@lean_device
def _open(nodes, tile, first, mirror, levels, level, lanes):  # type: ignore[no-untyped-def]
    """Find the children of a level's node that each ray among `lanes` meets."""
    child = 0.5 / (np.int64(1) << level)
    x, y, z = 2 * levels.cell[level, 0], 2 * levels.cell[level, 1], 2 * levels.cell[level, 2]
    start = load(tile.start, first)
    middle = _to_plane(tile, 0, first, (x + 1) * child)
    along = (
        larger(_to_plane(tile, 0, first, x * child), start),
        larger(middle, start),
        middle,
        _to_plane(tile, 0, first, (x + 2) * child),
    )
    y0, y1, y2 = _three_planes(tile, 1, first, y, child)
    z0, z1, z2 = _three_planes(tile, 2, first, z, child)
    existing = mirrored_children(nodes.child_mask[levels.node[level]], mirror)
    found = levels.lanes[level]
    pending = np.int64(0)
    if existing & 0x03:
        pending |= _open_pair(found, existing, 0, lanes, along, larger(y0, z0), smaller(y1, z1))
    if existing & 0x0C:
        pending |= _open_pair(found, existing, 2, lanes, along, larger(y1, z0), smaller(y2, z1))
    if existing & 0x30:
        pending |= _open_pair(found, existing, 4, lanes, along, larger(y0, z1), smaller(y1, z2))
    if existing & 0xC0:
        pending |= _open_pair(found, existing, 6, lanes, along, larger(y1, z1), smaller(y2, z2))
    levels.pending[level] = pending


@lean_device
def _three_planes(tile, axis, first, cell, child):  # type: ignore[no-untyped-def]
    """Lengths to the lower, middle and upper plane of a node whose first child has this cell."""
    return (
        _to_plane(tile, axis, first, cell * child),
        _to_plane(tile, axis, first, (cell + 1) * child),
        _to_plane(tile, axis, first, (cell + 2) * child),
    )


@lean_device
def _open_pair(found, existing, octant, lanes, along, enter, leave):  # type: ignore[no-untyped-def]
    """Write the lanes that meet an octant and its neighbour along x; returns the bits of those that some lane meets.

    along: lengths at which rays enter the lower and the upper of both, and at which they leave them.
    """
    pending = np.int64(0)
    if (existing >> octant) & 1:
        met = lanes & less(larger(along[0], enter), smaller(along[2], leave))
        found[octant] = met
        if met != 0:
            pending |= np.int64(1) << octant
    if (existing >> (octant + 1)) & 1:
        met = lanes & less(larger(along[1], enter), smaller(along[3], leave))
        found[octant + 1] = met
        if met != 0:
            pending |= np.int64(1) << (octant + 1)
    return pending
