# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of a node along a direction, for kernels; `node_light.py` defines it."""

from __future__ import annotations

import numpy as np

from ..cells.scales import LUMINANCE_SCALE
from ..runtime.kernels import device, kernel
from ..runtime.vectors import count_ones
from ..surface.chroma_kernels import decode_color
from ..surface.side_kernels import face_towards

_ROOT_SCALE = np.float32(LUMINANCE_SCALE / 255.0**2)  # luminance of a face is the square of a byte
_LEAST = np.float32(1)  # weight of the mean, 255 = a whole face: it dominates where hardly any surface faces the ray
_OF_BLACK = np.float32(0.125)  # of black backs
_LEAST_SHARE = 7  # of 255: up to this visible share, a face has the mean


@device
def row_of(marked, node):
    """Row of a node among those marked by `bits` and `ranks`, -1 for other nodes and for node -1."""
    word = node >> 6
    if node < 0 or word >= len(marked.bits):
        return np.int64(-1)
    bits, bit = marked.bits[word], np.uint64(1) << np.uint64(node & 63)
    if bits & bit == 0:
        return np.int64(-1)
    return np.int64(marked.ranks[word]) + count_ones(bits & (bit - np.uint64(1)))


@device
def luminance_along(light, node, x, y, z):
    """Luminance, 65535 = 1, float32, of a node along a direction."""
    row = row_of(light.sides, node)
    return np.float32(light.luminance[node]) if row < 0 else luminance_of_sides(light, node, row, x, y, z)


@device
def luminance_of_sides(light, node, row, x, y, z):
    """Luminance, 65535 = 1, float32, of a node's sides in a row along a direction."""
    sides = light.sides
    backs = _backs_are_seen(sides, row, x, y, z)
    a, a_weight = _face_along(sides, row, np.int64(0), x, backs)
    b, b_weight = _face_along(sides, row, np.int64(1), y, backs)
    c, c_weight = _face_along(sides, row, np.int64(2), z, backs)
    seen = a_weight + b_weight + c_weight
    rest = _rest(sides, row, seen, backs, x, y, z)
    return (rest * np.float32(light.luminance[node]) + a + b + c) / (rest + seen)


@device
def _backs_are_seen(sides, row, x, y, z):
    """Whether the surface facing a direction is mostly backs: a ray sees one side of a sheet.

    Black backs count an eighth: they are dark because a front covers them, as inside an open box.
    """
    front, back = np.float32(0), np.float32(0)
    for axis in range(3):
        along = x if axis == 0 else y if axis == 1 else z
        face = face_towards(axis, -along)
        share = sides.share[row, face]
        weight = np.float32(abs(along)) * np.float32(share)
        if share & 1 == 0:
            front += weight
        else:
            back += weight if sides.light[row, face] > 0 else weight * _OF_BLACK
    return back > front


@device
def _rest(sides, row, seen, backs, x, y, z):
    """Weight of the mean beside the `seen` part of faces along a direction: the node's open part, and a little.

    The mean is that of fronts, which are hardly seen where `backs` are.
    """
    through = np.float32(abs(x) + abs(y) + abs(z)) * np.float32(255) - seen
    return _LEAST + (through if sides.inner[row] and not backs else np.float32(0))


@device
def _face_along(sides, row, axis, along, backs):
    """Luminance times weight, and weight, of the face across an axis that a direction runs against.

    backs: only faces of backs count, else only those of fronts.
    """
    face = face_towards(axis, -along)
    share = sides.share[row, face]
    weight = np.float32(abs(along)) * np.float32(share) if (share & 1 == 1) == backs else np.float32(0)
    root = np.float32(sides.light[row, face])
    return weight * root * root * _ROOT_SCALE, weight


@device
def side_root(sides, row, face, mean):
    """Root of the luminance of a face, float32; the root of the `mean` where hardly any surface faces it."""
    return np.float32(sides.light[row, face]) / np.float32(255) if sides.share[row, face] > _LEAST_SHARE else mean


@device
def color_along(sides, row, mean, x, y, z):
    """Linear colour of sides along a direction; mean: the node's colour."""
    red, green, blue, seen = 0.0, 0.0, 0.0, np.float32(0)
    backs = _backs_are_seen(sides, row, x, y, z)
    for axis in range(3):
        along = x if axis == 0 else y if axis == 1 else z
        face = face_towards(axis, -along)
        light, weight = _face_along(sides, row, np.int64(axis), along, backs)
        r, g, b = decode_color(light / LUMINANCE_SCALE, sides.chroma[row, face, 0], sides.chroma[row, face, 1])
        red, green, blue, seen = red + r, green + g, blue + b, seen + weight
    rest = _rest(sides, row, seen, backs, x, y, z)
    scale = 1.0 / np.float64(rest + seen)
    return (red + rest * mean[0]) * scale, (green + rest * mean[1]) * scale, (blue + rest * mean[2]) * scale


@kernel
def see_luminance(first, last, light, nodes, directions, seen):
    """Write luminances (P,) float32 of nodes (P,) int64 along directions (P, 3), 0 for -1 (no node)."""
    for i in range(first, last):
        way = directions[i]
        found = luminance_along(light, nodes[i], way[0], way[1], way[2]) if nodes[i] >= 0 else np.float32(0)
        seen[i] = found / np.float32(LUMINANCE_SCALE)


@kernel
def see_colors(first, last, sides, nodes, directions, seen):
    """Replace colours (P, 3) float32 of nodes (P,) int64 by those of their sides along directions (P, 3)."""
    for i in range(first, last):
        row = row_of(sides, nodes[i])
        if row >= 0:
            way = directions[i]
            mean = np.float64(seen[i, 0]), np.float64(seen[i, 1]), np.float64(seen[i, 2])
            seen[i, 0], seen[i, 1], seen[i, 2] = color_along(sides, row, mean, way[0], way[1], way[2])
