# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays of a packet against the pieces of a leaf: the triangles in it, each tested in all vector lanes at once.

Möller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
"""

from __future__ import annotations

import numpy as np

from ..octree.pieces import LAST, TRIANGLE
from ..runtime.kernels import device
from ..runtime.vectors import LANES, larger, less, load, put, select, splat
from .tile import DIRECTION, ORIGIN, PIECE, RAYS, START, WEIGHTS

_SLACK = 0.01  # of a leaf's side, beyond the ends of its box
_ROUNDING = 3e-7  # of corners, in the octree's cube
_EDGE = 1e-7  # beyond the edges of triangles, so that no ray passes between two


@device
def meet_pieces(nodes, tile, packet, mirror, leaf, size, through):
    """Lanes that meet a piece of a leaf, and the lengths to the nearest; stores the pieces.

    leaf: a node with pieces, of side `size`. through: the lanes that meet its box, lengths at which they enter and
    leave it.
    """
    lanes, enter, leave = through
    first = packet * LANES
    slack = splat(_SLACK * size + _ROUNDING)
    start = larger(enter - slack, load(tile.numbers, START * RAYS + first))
    nearest = leave + slack
    ox, dx = _rays(tile, 0, first, mirror & 1)
    oy, dy = _rays(tile, 1, first, mirror & 2)
    oz, dz = _rays(tile, 2, first, mirror & 4)
    found, index = np.int64(0), np.int64(nodes.first_child[leaf])
    while True:
        piece = np.int64(nodes.pieces[index])
        row = piece & np.int64(TRIANGLE)
        ax, ay, az = _corner(nodes, row, 0)
        bx, by, bz = _corner(nodes, row, 1)
        cx, cy, cz = _corner(nodes, row, 2)
        b0, b1, b2 = bx - ax, by - ay, bz - az
        c0, c1, c2 = cx - ax, cy - ay, cz - az
        px = dy * splat(c2) - dz * splat(c1)
        py = dz * splat(c0) - dx * splat(c2)
        pz = dx * splat(c1) - dy * splat(c0)
        volume = splat(b0) * px + splat(b1) * py + splat(b2) * pz  # above 0 in front
        scale = splat(1.0) / volume
        x, y, z = ox - splat(ax), oy - splat(ay), oz - splat(az)
        one = (x * px + y * py + z * pz) * scale
        met = lanes & less(splat(-_EDGE), one)
        if met != 0:
            qx = y * splat(b2) - z * splat(b1)
            qy = z * splat(b0) - x * splat(b2)
            qz = x * splat(b1) - y * splat(b0)
            two = (dx * qx + dy * qy + dz * qz) * scale
            length = (splat(c0) * qx + splat(c1) * qy + splat(c2) * qz) * scale
            met &= less(splat(-_EDGE), two) & less(one + two, splat(1.0 + _EDGE))
            met &= less(start, length) & less(length, nearest)
            if met != 0:
                found |= met
                nearest = select(met, length, nearest)
                front, back = splat(2.0 * index), splat(2.0 * index + 1.0)
                put(tile.numbers, PIECE * RAYS + first, met, select(less(splat(0.0), volume), front, back))
                put(tile.numbers, WEIGHTS * RAYS + first, met, one)
                put(tile.numbers, (WEIGHTS + 1) * RAYS + first, met, two)
        if piece & np.int64(LAST):
            break
        index += 1
    return found, nearest


@device
def _corner(nodes, row, corner):
    """Corner of a triangle."""
    corners, first = nodes.corners, 3 * corner
    return np.float64(corners[row, first]), np.float64(corners[row, first + 1]), np.float64(corners[row, first + 2])


@device
def _rays(tile, axis, first, mirrored):
    """Origins and directions of a packet's rays on an axis, not mirrored."""
    origin = load(tile.numbers, (ORIGIN + axis) * RAYS + first)
    if mirrored:
        origin = splat(1.0) - origin
    return origin, load(tile.numbers, (DIRECTION + axis) * RAYS + first)
