# SPDX-License-Identifier: GPL-3.0-or-later
"""Outer cells of a pixel: the share of the pixel that each cell around its voxel alone covers, and their luminances.

A cell is represented by the box around its children, projected as in `footprint.py`, filled as the columns of its
children along the ray, with the luminance of the faces that the ray hits (methods 11.2). Occupied cells around a voxel
are listed and unpacked once for all its pixels, and measured in vector lanes.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ..network.compiled_layers import TILE, empty_values
from ..network.kinds import CHILDREN, CORNERS, OUTER
from ..runtime.kernels import array_device, device
from ..runtime.vectors import LANES, larger, load, lowest_one, smaller, splat, square_root, store, words_set
from .corner_cells import BASE, BASE_STEPS, SLOPE, SLOPE_BITS, SLOPE_STEPS
from .ray_frame import CELLS, SIDE

_INNER = [n for n in range(CELLS) if all(1 <= n // SIDE**axis % SIDE <= 2 for axis in range(3))]
OUTER_CELLS = np.setdiff1d(np.arange(CELLS), _INNER)  # (56,) cells of the 4x4x4 that are not in the voxel
OUTER_PLACE = np.zeros(CELLS, np.uint64)  # their rows in a tile; other rows are undefined
OUTER_PLACE[OUTER_CELLS] = np.arange(OUTER)
assert len(OUTER_CELLS) == OUTER

_LISTED = TILE  # capacity of a tile's row: cells are measured in vectors of LANES
assert OUTER <= _LISTED and _LISTED % LANES == 0
# Rows of a cell's numbers: the middle of the box around its children, in sides of the voxel, which starts at 0, its
# half sides, and the share of columns with a child, along each axis; and luminances of the faces across them.
_MIDDLE, _HALF, _SEEN, _LIGHT, _ROWS = 0, 3, 6, 9, 15
SMALL = 1e-9  # prevents division by 0 for a box that is a line
# Fields of a mask's geometry: whether the lower and the upper half of each axis hold children, and the number of
# columns along it with a child.
_LOWER, _UPPER, _COLUMNS, _COUNT_BITS = 0, 3, 6, 3


class OuterList(NamedTuple):
    """List of the occupied outer cells around one voxel, (64,) each.

    word: uint32, see `corner_cells.py`. geometry: uint32 of its mask. number: int32, 8 corner + octant. values: 15 rows
    of float32, unpacked from these, see `unpack_cells`. covered, shown: float32, results.
    """

    word: np.ndarray
    geometry: np.ndarray
    number: np.ndarray
    values: np.ndarray
    covered: np.ndarray
    shown: np.ndarray


@cache
def mask_geometry() -> np.ndarray:
    """Occupied halves and columns of each child mask, (256,) uint32."""
    masks = np.arange(256)
    found = np.zeros(256, np.int64)
    for axis in range(3):
        lower = sum(1 << octant for octant in range(8) if not octant >> axis & 1)
        found |= ((masks & lower) != 0).astype(np.int64) << (_LOWER + axis)
        found |= ((masks & ~lower) != 0).astype(np.int64) << (_UPPER + axis)
        columns = (masks | masks >> (1 << axis)) & lower
        counts = np.array([int(value).bit_count() for value in columns])
        found |= counts << (_COLUMNS + _COUNT_BITS * axis)
    return found.astype(np.uint32)


@array_device
def empty_outer_list():
    """Allocate a list of the cells around a voxel."""
    values = empty_values(_ROWS + 2)
    return OuterList(
        np.zeros(_LISTED, np.uint32),
        np.zeros(_LISTED, np.uint32),
        np.zeros(_LISTED, np.int32),
        values[: _ROWS * _LISTED],
        values[_ROWS * _LISTED : (_ROWS + 1) * _LISTED],
        values[(_ROWS + 1) * _LISTED :],
    )


@device
def list_cells(words, start, corner, geometry, listed, count):
    """Append the occupied cells around a corner, whose words begin at `start`; returns the new length.

    geometry: `mask_geometry`. The cell in the voxel itself is skipped.
    """
    word_list, geometry_list, numbers = listed.word, listed.geometry, listed.number
    left = words_set(words, start) & ~(np.int64(1) << (CORNERS - 1 - corner))
    while left != 0:
        octant = lowest_one(left)
        left &= left - 1
        word = words[start + octant]
        word_list[count] = word
        geometry_list[count] = geometry[word & np.uint32(255)]
        numbers[count] = CORNERS * corner + octant
        count += 1
    return count


@device
def unpack_cells(listed, count):
    """Write the numbers of the first `count` cells of a list; later ones are undefined."""
    words, geometries, numbers, values = listed.word, listed.geometry, listed.number, listed.values
    for axis in range(3):
        for index in range(-(-count // LANES) * LANES):
            word, geometry, number = np.int32(words[index]), np.int32(geometries[index]), numbers[index]
            values[(_MIDDLE + axis) * _LISTED + index] = _middle(geometry, number, axis)
            values[(_HALF + axis) * _LISTED + index] = _half(geometry, axis)
            values[(_SEEN + axis) * _LISTED + index] = _columns(geometry, axis)
            lower, upper = _lights(word, axis)
            values[(_LIGHT + 2 * axis) * _LISTED + index] = lower
            values[(_LIGHT + 2 * axis + 1) * _LISTED + index] = upper


@device
def measure_cells(listed, count, ray, order, covered, shown, place):
    """Write the shares of a pixel that listed cells cover, and their luminances, into column `place` of outer cells.

    The cells must be unpacked. ray: `PixelRay`. order: (64,) of `nearby_order` in the ray's frame. covered, shown:
    (64 * TILE,) rows of children, then of outer cells.
    """
    _measure(listed, count, ray)
    numbers, areas, lights = listed.number, listed.covered, listed.shown
    for index in range(count):
        row = (np.uint64(CHILDREN) + OUTER_PLACE[order[numbers[index]]]) * np.uint64(TILE) + np.uint64(place)
        covered[row] = areas[index]
        shown[row] = lights[index]


@device
def _measure(listed, count, ray):
    """Write areas and luminances of the first `count` cells of a list; later ones are undefined."""
    entry, direction, up, ratio = ray
    values, areas, lights = listed.values, listed.covered, listed.shown
    right_x = direction[1] * up[2] - direction[2] * up[1]
    right_y = direction[2] * up[0] - direction[0] * up[2]
    right_z = direction[0] * up[1] - direction[1] * up[0]
    start_right = -(entry[0] * right_x + entry[1] * right_y + entry[2] * right_z)
    start_up = -(entry[0] * up[0] + entry[1] * up[1] + entry[2] * up[2])
    half = splat(np.float32(0.5) * ratio)
    along_x, along_y, along_z = splat(abs(direction[0])), splat(abs(direction[1])), splat(abs(direction[2]))
    column, pixel = splat(np.float32(1 / 16)), splat(ratio * ratio)
    for first in range(0, count, LANES):
        x, y, z = _three(values, _HALF, first)
        area = splat(np.float32(4)) * (along_x * y * z + along_y * x * z + along_z * x * y)
        across, wide = _extent(values, first, start_right, (right_x, right_y, right_z))
        above, high = _extent(values, first, start_up, (up[0], up[1], up[2]))
        scale = square_root(area / (splat(np.float32(4)) * wide * high + splat(np.float32(SMALL))))
        overlap = inside_pixel(across, wide * scale, half) * inside_pixel(above, high * scale, half)
        x, y, z = _three(values, _SEEN, first)
        x, y, z = along_x * x, along_y * y, along_z * z
        seen = x + y + z
        light = x * _met_light(values, direction, 0, first) + y * _met_light(values, direction, 1, first)
        light = light + z * _met_light(values, direction, 2, first)
        store(areas, first, overlap * (column * seen / area) / pixel)
        store(lights, first, light / seen)


@device
def _three(values, row, first):
    """Vectors of three rows of numbers, one for each axis."""
    at = row * _LISTED + first
    return load(values, at), load(values, at + _LISTED), load(values, at + 2 * _LISTED)


@device
def _extent(values, first, start, plane):
    """Vectors of the middles of the boxes around cells along an axis of the picture, and of their half sides."""
    x, y, z = _three(values, _MIDDLE, first)
    middle = splat(start) + x * splat(plane[0]) + y * splat(plane[1]) + z * splat(plane[2])
    x, y, z = _three(values, _HALF, first)
    return middle, x * splat(abs(plane[0])) + y * splat(abs(plane[1])) + z * splat(abs(plane[2]))


@device
def inside_pixel(middle, reach, half):
    """Vector of the part within pixels, of half side `half`, of intervals around a middle."""
    none = splat(np.float32(0))
    return larger(smaller(middle + reach, half) - larger(middle - reach, none - half), none)


@device
def _met_light(values, direction, axis, first):
    """Vector of the luminances of the faces that a ray hits along an axis."""
    row = _LIGHT + 2 * axis + (1 if direction[axis] < 0 else 0)
    return load(values, row * _LISTED + first)


@device
def _middle(geometry, number, axis):
    """Middle of the box around a cell's children, in sides of the voxel, which starts at 0."""
    cell = np.float32((number >> np.int32(3 + axis)) & np.int32(1)) - np.float32(0.25)
    cell += np.float32(0.5) * np.float32((number >> np.int32(axis)) & np.int32(1))
    upper, lower = (geometry >> np.int32(_UPPER + axis)) & np.int32(1), (geometry >> np.int32(axis)) & np.int32(1)
    return cell + np.float32(0.125) * np.float32(upper - lower)


@device
def _half(geometry, axis):
    """Half the side of that box."""
    upper, lower = (geometry >> np.int32(_UPPER + axis)) & np.int32(1), (geometry >> np.int32(axis)) & np.int32(1)
    return np.float32(0.125) * np.float32(upper + lower)


@device
def _columns(geometry, axis):
    """Columns of a cell along an axis that hold a child."""
    return np.float32((geometry >> np.int32(_COLUMNS + _COUNT_BITS * axis)) & np.int32(7))


@device
def _lights(word, axis):
    """Luminances of a cell's two faces across an axis, the lower one first."""
    base = np.float32((word >> np.int32(BASE)) & np.int32(255)) * np.float32(1 / BASE_STEPS)
    field = (word >> np.int32(SLOPE + SLOPE_BITS * axis)) & np.int32((1 << SLOPE_BITS) - 1)
    steps = np.float32(field - np.int32(SLOPE_STEPS)) * np.float32(1 / SLOPE_STEPS)
    half = np.float32(0.5) * steps * abs(steps)
    lower = min(max(base - half, np.float32(0)), np.float32(1))
    upper = min(max(base + half, np.float32(0)), np.float32(1))
    return lower * lower, upper * upper
