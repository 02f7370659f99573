# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface sums per leaf in fixed point: integer sums are independent of the order, and so is the octree.

Sums of a leaf's sides are floats, which take half the memory; an octree stores 8 bits of them. Leaves are stored in
bricks of cells (`bricks.py`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.bounds import INT32_COUNT, NODE_ADVICE, check_count
from ..runtime.kernels import device, kernel
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.mesh import Fragments
from .bricks import BRICK_BITS, BRICK_CELLS, brick_of, table_of
from .leaf_boxes import WHOLE, ends_of_axis, joined_boxes, unpacked
from .side_levels import LeafSides, leaf_sides
from .sides import FACES

# The unit of a leaf's area is 2^-40 of a voxel's face: four million coincident layers fit, and smaller areas count as
# one unit, so that every touched voxel is kept. Luminance times area needs more bits, as do red and blue: multiples of
# 2^24 units, and the remainder. Green follows from luminance and those two.
_AREA_UNITS = 2.0**40
_WHOLE = 2.0**24
_PART = 2.0**-16
_MAX_LUMINANCE = 2.0**32
MIN_OPACITY = 1.0 / 255.0
# Weight of a fragment's light by its place, from the far end of a voxel to the near one in 32nds, where a voxel holds
# several layers: what lies behind is hidden, as the layer under a slab is.
_IN_FRONT = np.exp(32.0 * np.arange(-15, 16) / 32.0)
_COLUMNS = 6  # area, luminance as quotient and remainder, normal (x, y, z); each weighted by area
_COLOR_COLUMNS = _COLUMNS + 4  # and red and blue, each as quotient and remainder
_CHANNELS, _COLOR_CHANNELS = 4, 6  # of a face: see `leaf_sides`
_ALL_FRONT = np.empty(0, np.int8)
_NO_COLOR = np.empty((0, 3), np.float32)
_NO_LIGHTS = np.empty((0, 2, 1), np.float32)


class _Shading(NamedTuple):
    """Luminance (F,) and opacity (F,) float32 of fragments, and their colour (F, 3) float32, or (0, 3) without.

    facing: (T,) int8, lit side of a triangle: 1 front, -1 back, 0 both; (0,) if all are 1. lights: (F, 2, 1 or 4)
    float32, luminance, and colour, of front and back; (0, 2, 1) if both have the fragment's luminance.
    """

    luminance: np.ndarray
    opacity: np.ndarray
    color: np.ndarray
    facing: np.ndarray
    lights: np.ndarray


class _Bricks(NamedTuple):
    """Bricks of leaves, and the leaves' sums.

    table: (a power of two,) int32 hash table of bricks, -1 where empty. keys: (B,) uint64 of the bricks.
    rows: (B * 64,) int32, 1 + row of each cell, 0: none yet. sums: (R * columns,) int64 of the leaves.
    boxes: (R,) uint32 packed, around what is in each leaf. faces: (R * 2 * 6 * channels,) float32, sums of the sides
    of leaves, see `leaf_sides`; (0,) without.
    used: (2,) int64, how many bricks and leaves there are.
    """

    table: np.ndarray
    keys: np.ndarray
    rows: np.ndarray
    sums: np.ndarray
    boxes: np.ndarray
    faces: np.ndarray
    used: np.ndarray


class LeafAccumulator:
    """Sums over fragments of leaves of side `voxel_size_world`; `take` returns them in the order of keys."""

    def __init__(self, voxel_size_world: float, *, sides: bool = False, only_keys: bool = False) -> None:
        """Begin without leaves; only_keys: with cells and boxes, without sums."""
        self._area_unit = voxel_size_world**2 / _AREA_UNITS
        self._columns = 0 if only_keys else _COLUMNS
        self._sides = sides and not only_keys
        keys = np.zeros(1 << 10, np.uint64)
        rows = np.zeros(BRICK_CELLS << 10, np.int32)
        sums = np.zeros(self._columns << 12, np.int64)
        boxes = np.zeros(1 << 12, np.uint32)
        faces = np.zeros(self._face_numbers << 12, np.float32)
        self._bricks = _Bricks(table_of(keys, 0), keys, rows, sums, boxes, faces, np.zeros(2, np.int64))

    def __len__(self) -> int:
        """Number of leaves."""
        return int(self._bricks.used[1])

    @property
    def _face_numbers(self) -> int:
        """Number of values of a leaf's sides."""
        return 2 * FACES * (_CHANNELS if self._columns == _COLUMNS else _COLOR_CHANNELS) if self._sides else 0

    def add(
        self,
        fragments: Fragments,
        luminance: np.ndarray,
        opacity: np.ndarray,
        normals: np.ndarray,
        color: np.ndarray | None = None,
        lights: np.ndarray | None = None,
        *,
        facing: np.ndarray | None = None,
    ) -> None:
        """Add fragments with their luminance (F,), opacity (F,) and the unit normals (T, 3) of their triangles.

        color: (F, 3) linear, scaled to the luminance here; given in all calls or in none, as (F, 0). lights: of both
        sides, see `ShadingFn`. facing: (T,) int8, lit side of a triangle, see `build_octree`. Fragments with an opacity
        below 1/255 are ignored.
        """
        color = None if color is not None and (color.shape[1] == 0 or self._columns == 0) else color
        if color is not None and len(self) == 0 and self._columns == _COLUMNS:
            self._columns = _COLOR_COLUMNS
            sums, faces = np.zeros(_COLOR_COLUMNS << 12, np.int64), np.zeros(self._face_numbers << 12, np.float32)
            self._bricks = self._bricks._replace(sums=sums, faces=faces)
        shading = _Shading(
            np.asarray(luminance, np.float32),
            np.asarray(opacity, np.float32),
            _NO_COLOR if color is None else np.asarray(color, np.float32),
            _ALL_FRONT if facing is None else facing,
            _NO_LIGHTS if lights is None else lights,
        )
        boxes = np.full(len(fragments), WHOLE, np.uint32) if fragments.boxes is None else fragments.boxes
        first = 0
        while first < len(fragments):
            units = self._columns, 1.0 / self._area_unit
            first = _add(first, fragments.arrays, boxes, shading, normals, units, self._bricks)
            if first < len(fragments):
                self._grow()

    def _grow(self) -> None:
        """Enlarge the arrays by half, in place, so that old and new arrays do not coexist.

        Raises SettingError beyond 32-bit rows and bricks.
        """
        bricks, leaves = (int(value) for value in self._bricks.used)
        check_count(leaves + 1, INT32_COUNT - 1, "leaves of one part of an octree", NODE_ADVICE)  # fewer bricks
        if bricks == len(self._bricks.keys):
            more = bricks + bricks // 2
            self._bricks.keys.resize(more, refcheck=False)
            self._bricks.rows.resize(more * BRICK_CELLS, refcheck=False)
            self._bricks = self._bricks._replace(table=table_of(self._bricks.keys, bricks))
        if leaves == len(self._bricks.boxes):
            room = min(leaves + leaves // 2, INT32_COUNT - 1)
            self._bricks.sums.resize(room * self._columns, refcheck=False)
            self._bricks.boxes.resize(room, refcheck=False)
            self._bricks.faces.resize(room * self._face_numbers, refcheck=False)

    def take(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, LeafSides | None]:
        """Keys (n,) uint64, ascending, sums, boxes and sides, as in `LeafSums`."""
        bricks, leaves = (int(value) for value in self._bricks.used)
        keys = np.empty(leaves, np.uint64)
        sums = np.empty((leaves, {0: 0, _COLUMNS: 5}.get(self._columns, 7)), np.float32)
        order = np.argsort(self._bricks.keys[:bricks])
        boxes, row = np.empty(leaves, np.uint32), np.empty(leaves, np.int32)
        _emit(order, self._bricks, self._area_unit, keys, sums, boxes, row)
        sides = None
        if self._sides:
            faces = self._bricks.faces[: leaves * self._face_numbers].reshape(leaves, 2, FACES, -1)
            sides = leaf_sides(faces, row, sums, self._area_unit * _AREA_UNITS, unpacked(boxes))
        return keys, sums, unpacked(boxes), sides


@device
def _add_large(rows, row, product):  # type: ignore[no-untyped-def]
    """Add to a sum stored in two columns: quotient and remainder."""
    whole = np.rint(product / _WHOLE)
    rows[row] += np.int64(whole)
    rows[row + 1] += np.int64(np.rint((product - whole * _WHOLE) / _PART))


@device
def _red_and_blue(color, luminance):  # type: ignore[no-untyped-def]
    """Red and blue of a colour (3,) scaled to a luminance; gray for black and NaN."""
    red = float(color[0]) if color[0] > 0.0 else 0.0
    green = float(color[1]) if color[1] > 0.0 else 0.0
    blue = float(color[2]) if color[2] > 0.0 else 0.0
    own = RED * red + GREEN * green + BLUE * blue
    if not 0.0 < own < np.inf:
        return luminance, luminance
    scale = luminance / own
    return min(red * scale, _MAX_LUMINANCE), min(blue * scale, _MAX_LUMINANCE)


@kernel
def _add(first, fragments, boxes, shading, normals, columns_and_units, bricks):  # type: ignore[no-untyped-def]
    """Add fragments from `first` on; returns the first without room, or their number."""
    columns, units = columns_and_units
    keys, triangle, area = fragments.keys, fragments.triangle, fragments.area_world
    opacity, color = shading.opacity, shading.color
    table, brick_key, brick_rows, rows, leaf_boxes, faces, count = bricks
    brick = np.int64(-1)
    for i in range(first, len(keys)):
        if not opacity[i] >= MIN_OPACITY:
            continue
        brick = brick_of(keys[i], brick, table, brick_key, count)
        if brick < 0:
            return i
        cell = brick * BRICK_CELLS + np.int64(keys[i] & np.uint64(BRICK_CELLS - 1))
        if brick_rows[cell] == 0:
            if count[1] == len(leaf_boxes):
                return i
            leaf_boxes[count[1]] = boxes[i]
            count[1] += 1
            brick_rows[cell] = count[1]
        leaf = np.int64(brick_rows[cell]) - 1
        leaf_boxes[leaf] = joined_boxes(leaf_boxes[leaf], boxes[i])
        if columns == 0:
            continue
        row = leaf * columns
        weight = max(np.rint(area[i] * opacity[i] * units), 1.0)
        luminance = float(shading.luminance[i])
        luminance = min(max(luminance, -_MAX_LUMINANCE), _MAX_LUMINANCE) if luminance == luminance else 0.0
        rows[row] += np.int64(weight)
        _add_large(rows, row + 1, weight * luminance)
        for axis in range(3):
            rows[row + 3 + axis] += np.int64(np.rint(weight * normals[triangle[i], axis]))
        red, blue = _red_and_blue(color[i], luminance) if columns == _COLOR_COLUMNS else (0.0, 0.0)
        if columns == _COLOR_COLUMNS:
            _add_large(rows, row + 6, weight * red)
            _add_large(rows, row + 8, weight * blue)
        if len(faces):
            facing = shading.facing[triangle[i]] if len(shading.facing) else 1
            normal, light = normals[triangle[i]], (luminance, red, blue)
            if facing >= 0:
                own = _light_of(shading.lights[i, 0]) if len(shading.lights) else light
                _add_to_faces(faces, 2 * leaf, weight, normal, boxes[i], own, columns)
            if facing <= 0:
                own = _light_of(shading.lights[i, 1]) if len(shading.lights) else light
                _add_to_faces(faces, 2 * leaf + 1, -weight, normal, boxes[i], own, columns)
    return len(keys)


@device
def _light_of(values):  # type: ignore[no-untyped-def]
    """Luminance, red and blue of a side (1 or 4,)."""
    luminance = min(max(float(values[0]), -_MAX_LUMINANCE), _MAX_LUMINANCE) if values[0] == values[0] else 0.0
    red, blue = _red_and_blue(values[1:], luminance) if len(values) > 1 else (0.0, 0.0)
    return luminance, red, blue


@device
def _add_to_faces(faces, row, weight, normal, box, light, columns):  # type: ignore[no-untyped-def]
    """Add a fragment in a packed box to the three of six faces that it faces; for a negative `weight`, its back."""
    channels = _CHANNELS if columns == _COLUMNS else _COLOR_CHANNELS
    for axis in range(3):
        along = weight * normal[axis] / _AREA_UNITS
        at = (FACES * row + 2 * axis + (1 if along < 0.0 else 0)) * channels
        place = ends_of_axis(box, axis)
        front = abs(along) * _IN_FRONT[place if along > 0.0 else len(_IN_FRONT) - 1 - place]
        faces[at] += np.float32(abs(along))
        faces[at + 1] += np.float32(front)
        faces[at + 2] += np.float32(front * light[0])
        for channel in range(channels - 3):
            faces[at + 3 + channel] += np.float32(abs(along) * light[channel])


@kernel
def _emit(order, bricks, area_unit, keys, sums, boxes, places):  # type: ignore[no-untyped-def]
    """Leaves of the bricks in `order`, in Morton order, from fixed point to world units; places: their rows."""
    _, brick_key, brick_rows, rows, leaf_boxes, _, _ = bricks
    leaf = 0
    columns = _COLUMNS if sums.shape[1] == 5 else _COLOR_COLUMNS
    for brick in order:
        for cell in range(BRICK_CELLS):
            number = np.int64(brick_rows[brick * BRICK_CELLS + cell])
            if number == 0:
                continue
            row = (number - 1) * columns
            places[leaf] = number - 1
            boxes[leaf] = leaf_boxes[number - 1]
            keys[leaf] = (brick_key[brick] << np.uint64(BRICK_BITS)) | np.uint64(cell)
            if sums.shape[1] == 0:
                leaf += 1
                continue
            sums[leaf, 0] = rows[row] * area_unit
            sums[leaf, 1] = (rows[row + 1] * _WHOLE + rows[row + 2] * _PART) * area_unit
            for axis in range(3):
                sums[leaf, 2 + axis] = rows[row + 3 + axis] * area_unit
            for channel in range(sums.shape[1] - 5):
                column = row + _COLUMNS + 2 * channel
                sums[leaf, 5 + channel] = (rows[column] * _WHOLE + rows[column + 1] * _PART) * area_unit
            leaf += 1
