# SPDX-License-Identifier: GPL-3.0-or-later
"""Surface sums per leaf in fixed point: integer sums are independent of the order, and so is the octree.

Leaves are stored in bricks of cells (`bricks.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..cells.hashing import fill_slots, slots_for
from ..cells.leaf_box_kernels import joined_boxes
from ..cells.leaf_boxes import WHOLE, unpacked
from ..directional.leaf_sides import FACE_HUE, FACE_SUM, FaceSums, LeafSides, add_to_faces, leaf_sides
from ..runtime.bounds import INT32_COUNT, NODE_ADVICE, check_count
from ..runtime.kernels import device, kernel
from ..surface.chroma import BLUE, GREEN, RED
from ..surface.mesh import MIN_OPACITY, Fragments, Shading
from ..surface.side_kernels import is_lit, lit_sides
from ..surface.sides import FACES
from .bricks import BRICK_BITS, BRICK_CELLS, brick_of
from .collect_pieces import LeafPieces

# The unit of a leaf's area is 2^-40 of a voxel's face: four million coincident layers fit, and smaller areas count as
# one unit, so that every touched voxel is kept. Luminance times area needs more bits, as do red and blue: multiples of
# 2^24 units, and the remainder, `_part`. Green follows from luminance and those two.
_AREA_UNITS = 2.0**40
_WHOLE = 2.0**24
_PART = 2.0**-16
_MAX_LUMINANCE = 2.0**32
_ROOM = 1 << 12  # leaves at first

# Area, and area times luminance, normal (x, y, z), red and blue.
_LEAF_SUM = np.dtype([("area", "i8"), ("light", "i8"), ("light_part", "i8"), ("x", "i8"), ("y", "i8"), ("z", "i8")])
_LEAF_HUE = np.dtype([("red", "i8"), ("red_part", "i8"), ("blue", "i8"), ("blue_part", "i8")])


class SurfaceSums(NamedTuple):
    """Surface integrals of n leaves, in world units and weighted by opacity.

    area, light, normal: (n,), (n,) and (n, 3) float32, area, area * luminance, and area * normal; empty for keys only.
    red_blue: (n, 2) float32, area * red and area * blue, in colours of that luminance; (n, 0) without colour.
    """

    area: np.ndarray
    light: np.ndarray
    normal: np.ndarray
    red_blue: np.ndarray

    @staticmethod
    def empty(count: int, *, colored: bool) -> SurfaceSums:
        """Sums of any values."""
        area, light = np.empty((2, count), np.float32)
        return SurfaceSums(area, light, *(np.empty((count, k), np.float32) for k in (3, 2 if colored else 0)))


@dataclass(frozen=True, eq=False)
class LeafSums:
    """Leaf cells of one level, in ascending order of their key.

    keys: (n,) uint64. boxes: (n, 3) uint8 around the surface in each (`leaf_boxes.py`); None for whole voxels. sides:
    of the leaves whose sides differ; None without sides. pieces: of the leaves; None without.
    """

    level: int
    keys: np.ndarray
    sums: SurfaceSums
    boxes: np.ndarray | None = None
    sides: LeafSides | None = None
    pieces: LeafPieces | None = None


class _Bricks(NamedTuple):
    """Bricks of leaves, and the leaves' sums.

    keys: (B,) uint64 of the bricks, and the slots of these.
    rows: (B * 64,) int32, 1 + row of each cell, 0: none yet. boxes: (R,) uint32 packed, around what is in each leaf.
    sums: (R,) _LEAF_SUM, (0,) for keys only. hues: (R,) _LEAF_HUE, (0,) without colour. faces: of leaves; empty without
    sides. brick_count, leaf_count: (1,) int64, how many there are.
    """

    slots: np.ndarray
    keys: np.ndarray
    rows: np.ndarray
    boxes: np.ndarray
    sums: np.ndarray
    hues: np.ndarray
    faces: FaceSums
    brick_count: np.ndarray
    leaf_count: np.ndarray


class LeafAccumulator:
    """Sums over fragments of leaves of side `voxel_size_world`; `take` returns them in the order of keys."""

    def __init__(self, voxel_size_world: float, *, sides: bool = False, only_keys: bool = False) -> None:
        """Begin without leaves; only_keys: with cells and boxes, without sums."""
        self._area_unit = voxel_size_world**2 / _AREA_UNITS
        self._only_keys, self._sides = only_keys, sides and not only_keys
        keys, rows = np.zeros(1 << 10, np.uint64), np.zeros(BRICK_CELLS << 10, np.int32)
        boxes, sums = np.zeros(_ROOM, np.uint32), np.zeros(0 if only_keys else _ROOM, _LEAF_SUM)
        faces = FaceSums(np.zeros((_ROOM if self._sides else 0, 2, FACES), FACE_SUM), np.zeros((0, 2, FACES), FACE_HUE))
        counts = np.zeros(1, np.int64), np.zeros(1, np.int64)
        self._bricks = _Bricks(slots_for(len(keys)), keys, rows, boxes, sums, np.zeros(0, _LEAF_HUE), faces, *counts)

    def __len__(self) -> int:
        """Number of leaves."""
        return int(self._bricks.leaf_count[0])

    def add(self, fragments: Fragments, shading: Shading, normals: np.ndarray) -> None:
        """Add fragments with their light and the unit normals (T, 3) of their triangles.

        Colour is given in all calls or in none. Fragments with an opacity below 1/255 are ignored.
        """
        shading = shading.arrays
        if len(shading.color) and not len(self) and not self._only_keys:
            hues, faces = np.zeros(_ROOM, _LEAF_HUE), self._bricks.faces
            faces = faces._replace(hues=np.zeros(faces.sums.shape, FACE_HUE))
            self._bricks = self._bricks._replace(hues=hues, faces=faces)
        boxes = np.full(len(fragments), WHOLE, np.uint32) if fragments.boxes is None else fragments.boxes
        first = 0
        while first < len(fragments):
            first = _add(first, fragments.arrays, boxes, shading, normals, 1.0 / self._area_unit, self._bricks)
            if first < len(fragments):
                self._grow()

    def _grow(self) -> None:
        """Enlarge the arrays by half, in place, so that old and new arrays do not coexist.

        Raises SettingError beyond 32-bit rows and bricks.
        """
        bricks, leaves = int(self._bricks.brick_count[0]), len(self)
        check_count(leaves + 1, INT32_COUNT - 1, "leaves of one part of an octree", NODE_ADVICE)  # fewer bricks
        if bricks == len(self._bricks.keys):
            more = bricks + bricks // 2
            self._bricks.keys.resize(more, refcheck=False)
            self._bricks.rows.resize(more * BRICK_CELLS, refcheck=False)
            self._bricks = self._bricks._replace(slots=slots_for(more))
            fill_slots(self._bricks.slots, self._bricks.keys, np.arange(bricks))
        if leaves == len(self._bricks.boxes):
            room = min(leaves + leaves // 2, INT32_COUNT - 1)
            for values in (self._bricks.boxes, self._bricks.sums, self._bricks.hues, *self._bricks.faces):
                if len(values):
                    values.resize((room, *values.shape[1:]), refcheck=False)

    def take(self, level: int) -> LeafSums:
        """Leaves, which are of a level, without pieces."""
        leaves, unit = len(self), self._area_unit
        sums = SurfaceSums.empty(0 if self._only_keys else leaves, colored=len(self._bricks.hues) > 0)
        order = np.argsort(self._bricks.keys[: int(self._bricks.brick_count[0])])
        keys, packed, row = np.empty(leaves, np.uint64), np.empty(leaves, np.uint32), np.empty(leaves, np.int32)
        _emit(order, self._bricks, unit, keys, packed, row, sums)
        boxes, sides = unpacked(packed), None
        if self._sides:
            faces = FaceSums(*(values[:leaves] for values in self._bricks.faces))
            sides = leaf_sides(faces, row, boxes, sums.light / sums.area, sums.normal, unit * _AREA_UNITS)
        return LeafSums(level, keys, sums, boxes, sides)


@device
def _in_parts(product):
    """Quotient and remainder of a large sum."""
    whole = np.rint(product / _WHOLE)
    return np.int64(whole), np.int64(np.rint((product - whole * _WHOLE) / _PART))


@device
def _joined(whole, part, unit):
    return (whole * _WHOLE + part * _PART) * unit


@device
def _bounded(luminance):
    """Luminance within bounds; black for NaN."""
    return min(max(float(luminance), -_MAX_LUMINANCE), _MAX_LUMINANCE) if luminance == luminance else 0.0


@device
def _red_and_blue(color, luminance):
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
def _add(first, fragments, boxes, shading, normals, units, bricks):
    """Add fragments from `first` on; returns the first without room, or their number. units: of a world area of 1."""
    brick = np.int64(-1)
    for i in range(first, len(fragments.keys)):
        if not shading.opacity[i] >= MIN_OPACITY:
            continue
        key, triangle = fragments.keys[i], fragments.triangle[i]
        brick = brick_of(key, brick, bricks.slots, bricks.keys, bricks.brick_count)
        if brick < 0:
            return i
        cell = brick * BRICK_CELLS + np.int64(key & np.uint64(BRICK_CELLS - 1))
        if bricks.rows[cell] == 0:
            leaf = bricks.leaf_count[0]
            if leaf == len(bricks.boxes):
                return i
            bricks.boxes[leaf] = boxes[i]
            bricks.leaf_count[0] = bricks.rows[cell] = leaf + 1
        leaf = np.int64(bricks.rows[cell]) - 1
        bricks.boxes[leaf] = joined_boxes(bricks.boxes[leaf], boxes[i])
        if len(bricks.sums) == 0:
            continue
        luminance = _bounded(shading.luminance[i])
        weight = max(np.rint(fragments.area_world[i] * shading.opacity[i] * units), 1.0)
        _add_to_leaf(bricks.sums[leaf], weight, luminance, normals, triangle)
        red, blue = 0.0, 0.0
        if len(bricks.hues):
            red, blue = _red_and_blue(shading.color[i], luminance)
            _add_hue(bricks.hues[leaf], weight * red, weight * blue)
        if len(bricks.faces.sums) == 0:
            continue
        lit, normal = lit_sides(shading.lit, triangle), normals[triangle]
        for side in range(2):
            if is_lit(lit, side):
                light = _light_of(shading.sides[i, side]) if len(shading.sides) else (luminance, red, blue)
                add_to_faces(bricks.faces, leaf, side, weight / _AREA_UNITS, normal, boxes[i], light)
    return len(fragments.keys)


@device
def _add_to_leaf(sums, weight, luminance, normals, triangle):
    whole, part = _in_parts(weight * luminance)
    sums.area += np.int64(weight)
    sums.light += whole
    sums.light_part += part
    sums.x += np.int64(np.rint(weight * normals[triangle, 0]))
    sums.y += np.int64(np.rint(weight * normals[triangle, 1]))
    sums.z += np.int64(np.rint(weight * normals[triangle, 2]))


@device
def _add_hue(hue, red, blue):
    whole, part = _in_parts(red)
    hue.red += whole
    hue.red_part += part
    whole, part = _in_parts(blue)
    hue.blue += whole
    hue.blue_part += part


@device
def _light_of(values):
    """Luminance, red and blue of a side (1 or 4,)."""
    luminance = _bounded(values[0])
    red, blue = _red_and_blue(values[1:], luminance) if len(values) > 1 else (0.0, 0.0)
    return luminance, red, blue


@kernel
def _emit(order, bricks, unit, keys, boxes, row, sums):
    """Write leaves of the bricks in `order`, in Morton order, from fixed point to world units, and their rows."""
    leaf = 0
    for brick in order:
        for cell in range(BRICK_CELLS):
            own = np.int64(bricks.rows[brick * BRICK_CELLS + cell]) - 1
            if own < 0:
                continue
            keys[leaf] = (bricks.keys[brick] << np.uint64(BRICK_BITS)) | np.uint64(cell)
            boxes[leaf], row[leaf] = bricks.boxes[own], own
            if len(bricks.sums):
                found = bricks.sums[own]
                sums.area[leaf] = found.area * unit
                sums.light[leaf] = _joined(found.light, found.light_part, unit)
                sums.normal[leaf, 0] = found.x * unit
                sums.normal[leaf, 1] = found.y * unit
                sums.normal[leaf, 2] = found.z * unit
            if len(bricks.hues):
                hue = bricks.hues[own]
                sums.red_blue[leaf, 0] = _joined(hue.red, hue.red_part, unit)
                sums.red_blue[leaf, 1] = _joined(hue.blue, hue.blue_part, unit)
            leaf += 1
