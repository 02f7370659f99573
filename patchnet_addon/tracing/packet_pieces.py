# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays of a packet against the pieces of a leaf: the triangles in it, each tested in all vector lanes at once.

Möller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
"""

from __future__ import annotations

import numpy as np

from ..octree.pieces import LAST, TRIANGLE
from ..runtime.kernels import lean_device
from ..runtime.vectors import LANES, larger, less, load, put, select, splat
from .tile import DIRECTION, ORIGIN, PIECE, RAYS, START, WEIGHTS

_SLACK = 0.01  # of a leaf's side, beyond the ends of its box
_ROUNDING = 3e-7  # of corners, in the octree's cube
_EDGE = 1e-7  # beyond the edges of triangles, so that no ray passes between two


@lean_device
def meet_pieces(nodes, tile, packet, mirror, leaf, size, through):  # type: ignore[no-untyped-def]
    """Lanes that meet a piece of a leaf, and the lengths to the nearest; stores the pieces.

    leaf: a node with pieces, of side `size`. through: the lanes that meet its box, lengths at which they enter and
    leave it.
    """
    lanes, enter, leave = through
    first = packet * LANES
    slack = splat(_SLACK * size + _ROUNDING)
    start = larger(enter - slack, load(tile.numbers, START * RAYS + first))
    nearest = leave + slack
    ox, dx = _mirrored_ray(tile, 0, first, mirror & 1)
    oy, dy = _mirrored_ray(tile, 1, first, mirror & 2)
    oz, dz = _mirrored_ray(tile, 2, first, mirror & 4)
    back = float((mirror ^ (mirror >> 1) ^ (mirror >> 2)) & 1)  # of a triangle with a positive volume; mirrors turn it
    found = np.int64(0)
    index = np.int64(nodes.first_child[leaf])
    while True:
        piece = np.int64(nodes.pieces[index])
        row = piece & np.int64(TRIANGLE)
        ax, bx, cx = _corners(nodes.corners, row, 0, mirror & 1)
        ay, by, cy = _corners(nodes.corners, row, 1, mirror & 2)
        az, bz, cz = _corners(nodes.corners, row, 2, mirror & 4)
        b0, b1, b2 = splat(bx - ax), splat(by - ay), splat(bz - az)
        c0, c1, c2 = splat(cx - ax), splat(cy - ay), splat(cz - az)
        px, py, pz = dy * c2 - dz * c1, dz * c0 - dx * c2, dx * c1 - dy * c0
        volume = b0 * px + b1 * py + b2 * pz
        scale = splat(1.0) / volume
        x, y, z = ox - splat(ax), oy - splat(ay), oz - splat(az)
        one = (x * px + y * py + z * pz) * scale
        qx, qy, qz = y * b2 - z * b1, z * b0 - x * b2, x * b1 - y * b0
        two = (dx * qx + dy * qy + dz * qz) * scale
        length = (c0 * qx + c1 * qy + c2 * qz) * scale
        met = lanes & less(splat(-_EDGE), one) & less(splat(-_EDGE), two) & less(one + two, splat(1.0 + _EDGE))
        met &= less(start, length) & less(length, nearest)
        if met != 0:
            found |= met
            nearest = select(met, length, nearest)
            above, below = splat(2.0 * index + back), splat(2.0 * index + 1.0 - back)
            put(tile.numbers, PIECE * RAYS + first, met, select(less(splat(0.0), volume), above, below))
            put(tile.numbers, WEIGHTS * RAYS + first, met, one)
            put(tile.numbers, (WEIGHTS + 1) * RAYS + first, met, two)
        if piece & np.int64(LAST):
            break
        index += 1
    return found, nearest


@lean_device
def _mirrored_ray(tile, axis, first, mirrored):  # type: ignore[no-untyped-def]
    """Origins and directions of a packet's mirrored rays on an axis."""
    direction = load(tile.numbers, (DIRECTION + axis) * RAYS + first)
    if mirrored:
        direction = splat(0.0) - direction
    return load(tile.numbers, (ORIGIN + axis) * RAYS + first), direction


@lean_device
def _corners(corners, row, axis, mirrored):  # type: ignore[no-untyped-def]
    """Mirrored coordinates of a triangle's corners on an axis."""
    a, b, c = float(corners[row, axis]), float(corners[row, 3 + axis]), float(corners[row, 6 + axis])
    if mirrored:
        return 1.0 - a, 1.0 - b, 1.0 - c
    return a, b, c
