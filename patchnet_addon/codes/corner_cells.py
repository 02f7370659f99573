# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells around corners of voxels: shape and luminance of the eight cells of the next finer level, 32 bits each.

For a voxel's eight corners these are the 4x4x4 cells in it and up to half its side around it. A word is 0 for an empty
cell. Else its bits 0 to 7 are the cell's children (all eight for a leaf), and the rest the luminances of its six faces:
a face's luminance is the mean over its four columns of the child that a ray hits first. Bits 8 to 15 are the mean b of
the faces' roots, of 255; five bits from 16, 21 and 26 on, for each axis, 15 + 15 t, where the face hit by a ray up the
axis is (b - t|t| / 2)^2 and the opposite one (b + t|t| / 2)^2 (methods 11.2).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..network.kinds import CORNERS
from ..octree.octree import LUMINANCE_SCALE, Octree
from ..octree.side_kernels import side_root, sides_row
from ..runtime.kernels import device, kernel, lean_device
from ..runtime.threads import run_parts
from .brick import MIDDLE, child_at, covering_node
from .ray_frame import CELLS, SIDE

EMPTY = 0
BASE, BASE_STEPS = 8, 255  # first bit, and steps, of the mean root
SLOPE, SLOPE_BITS, SLOPE_STEPS = 16, 5, 15  # of the difference along an axis, in both directions
FACES = 6  # two along each axis, first the one hit by a ray up the axis

_COLUMNS = [[octant for octant in range(8) if not octant >> axis & 1] for axis in range(3)]  # lower child of each


def corner_cells(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Words (C, 8) uint32 of the cells, x fastest, around corners (C, 3) int32 of a level."""
    result = np.empty((len(corners), CORNERS), np.uint32)
    run_parts(_write_all, len(corners), octree.nodes, octree.light, level, corners, result)
    return result


@kernel
def _write_all(first, last, nodes, light, level, corners, result):  # type: ignore[no-untyped-def]
    work, words = empty_work(), result.reshape(-1)
    cells = work.cells
    together = len(cells) // CORNERS
    for start in range(first, last, together):
        end = min(start + together, last)
        for corner in range(start, end):
            here = corners[corner]
            x, y, z = 2 * np.int64(here[0]), 2 * np.int64(here[1]), 2 * np.int64(here[2])
            for octant in range(CORNERS):
                column, line, plane = octant & 1, (octant >> 1) & 1, octant >> 2
                node = covering_node(nodes, np.int64(0), level + 1, x - 1 + column, y - 1 + line, z - 1 + plane)
                cells[CORNERS * (corner - start) + octant] = node
        _write_words(nodes, light, work, words[CORNERS * start : CORNERS * end])


class CellWork(NamedTuple):
    """Scratch to write words of cells.

    cells: (64,) int64 nodes of cells, -1 for empty ones. place: (64,) int64 of occupied ones. lights: (8 * 64,) float32
    luminances of their children, by octant, below 0 for none. words: (64,) uint32 of occupied ones.
    """

    cells: np.ndarray
    place: np.ndarray
    lights: np.ndarray
    words: np.ndarray


@device
def empty_work():  # type: ignore[no-untyped-def]
    """Allocate the scratch of `write_cells_around`."""
    lights = np.empty(CORNERS * CELLS, np.float32)
    return CellWork(np.empty(CELLS, np.int64), np.empty(CELLS, np.int64), lights, np.empty(CELLS, np.uint32))


@lean_device
def write_cells_around(nodes, light, around, words, work):  # type: ignore[no-untyped-def]
    """Write the words (64,) of the cells around the corners of a voxel of an octree; around: see `Brick`.

    Cells in the voxel itself count as empty: pixels read them from the octree. work: a `CellWork`.
    """
    cells = work.cells
    cells[:] = -1
    for neighbour in range(27):
        x, y, z = neighbour % 3, neighbour // 3 % 3, neighbour // 9  # 1 is the voxel's own place
        node = np.int64(around[neighbour])
        if node < 0 or neighbour == MIDDLE:
            continue
        divided = nodes.child_mask[node] != 0
        for k in range(max(2 * z - 1, 0), min(2 * z + 1, SIDE)):
            for j in range(max(2 * y - 1, 0), min(2 * y + 1, SIDE)):
                for i in range(max(2 * x - 1, 0), min(2 * x + 1, SIDE)):  # cells of the 4x4x4
                    octant = (1 - (i & 1)) | (1 - (j & 1)) << 1 | (1 - (k & 1)) << 2  # they start half a voxel before
                    cell = child_at(nodes, node, octant) if divided else node
                    if cell >= 0:
                        prefetch(light.luminance, np.int64(nodes.first_child[cell]))
                    corner, inner = (i >> 1) | (j >> 1) << 1 | (k >> 1) << 2, (i & 1) | (j & 1) << 1 | (k & 1) << 2
                    cells[CORNERS * corner + inner] = cell
    _write_words(nodes, light, work, words)


@lean_device
def _write_words(nodes, light, work, words):  # type: ignore[no-untyped-def]
    """Write the words of the first of the cells in `work` into `words`, at most 64.

    Occupied ones are listed first, so that they are packed in vector lanes.
    """
    cells, places, lights, found = work.cells, work.place, work.lights, work.words
    masks, first_children = nodes.child_mask, nodes.first_child
    luminance, scale = light.luminance, np.float32(1.0 / LUMINANCE_SCALE)
    count = 0
    for place in range(len(words)):
        words[place] = EMPTY
        node = cells[place]
        if node < 0:
            continue
        places[count] = place
        mask, child = np.int64(masks[node]), np.int64(first_children[node])
        leaf = mask == 0
        mask, child = np.int64(255) if leaf else mask, node if leaf else child
        for octant in range(CORNERS):  # branchless, since a branch would be unpredictable
            there = mask >> octant & 1
            own = np.float32(luminance[child]) * scale
            lights[octant * CELLS + count] = own if there else np.float32(-1)
            child += 0 if leaf or mask >> octant < 2 else there  # stays at the last one
        found[count] = mask
        count += 1
    _pack(found, lights, count)
    for index in range(count):
        place = places[index]
        row = sides_row(light.sides, cells[place])
        words[place] = found[index] if row < 0 else _with_sides(found[index], light, cells[place], row)


@lean_device
def _with_sides(word, light, node, row):  # type: ignore[no-untyped-def]
    """Word with the luminances of a cell's own sides, where a surface faces them."""
    mean = np.sqrt(np.float32(light.luminance[node]) / np.float32(LUMINANCE_SCALE))
    total, packed = np.float32(0), np.int32(0)
    for axis in range(3):
        low, high = side_root(light.sides, row, 2 * axis + 1, mean), side_root(light.sides, row, 2 * axis, mean)
        total += low + high
        packed |= _slope_of(low, high) << np.int32(SLOPE + SLOPE_BITS * axis)
    base = np.int32(np.float32(BASE_STEPS) * (total / np.float32(FACES)) + np.float32(0.5))
    return np.uint32(np.int32(word & np.uint32(255)) | base << np.int32(BASE) | packed)


@lean_device
def _pack(words, lights, count):  # type: ignore[no-untyped-def]
    """Add to the first `count` words, which are masks, the luminances of faces; lights: see `CellWork`."""
    for index in range(count):
        a, b = lights[index], lights[CELLS + index]
        c, d = lights[2 * CELLS + index], lights[3 * CELLS + index]
        e, f = lights[4 * CELLS + index], lights[5 * CELLS + index]
        g, h = lights[6 * CELLS + index], lights[7 * CELLS + index]
        left, right = _root_of(a, c, e, g, b, d, f, h), _root_of(b, d, f, h, a, c, e, g)
        front, back = _root_of(a, b, e, f, c, d, g, h), _root_of(c, d, g, h, a, b, e, f)
        low, high = _root_of(a, b, c, d, e, f, g, h), _root_of(e, f, g, h, a, b, c, d)
        total = left + right + front + back + low + high
        mean = np.int32(np.float32(BASE_STEPS) * (total / np.float32(FACES)) + np.float32(0.5))
        word = mean << np.int32(BASE) | _slope_of(left, right) << np.int32(SLOPE)
        word |= _slope_of(front, back) << np.int32(SLOPE + SLOPE_BITS)
        word |= _slope_of(low, high) << np.int32(SLOPE + 2 * SLOPE_BITS)
        words[index] |= np.uint32(word)


@lean_device
def _slope_of(low, high):  # type: ignore[no-untyped-def]
    """Steps of the slope between the roots of two opposite faces."""
    half = min(max(np.float32(0.5) * (high - low), np.float32(-0.5)), np.float32(0.5))
    steps = np.int32(np.float32(SLOPE_STEPS) * np.sqrt(np.float32(2) * abs(half)) + np.float32(0.5))
    return np.int32(SLOPE_STEPS) + (-steps if half < 0 else steps)


@lean_device
def _root_of(a, b, c, d, behind_a, behind_b, behind_c, behind_d):  # type: ignore[no-untyped-def]
    """Root of the luminance of a face of a cell: of the children at it, or behind missing ones, below 0.

    Written out: loops with skips take three times as long.
    """
    none, one = np.float32(0), np.float32(1)
    a, b = a if a >= none else behind_a, b if b >= none else behind_b
    c, d = c if c >= none else behind_c, d if d >= none else behind_d
    total = max(a, none) + max(b, none) + max(c, none) + max(d, none)
    count = (one if a >= none else none) + (one if b >= none else none)
    count += (one if c >= none else none) + (one if d >= none else none)
    return np.sqrt(total / count)


_READ, _SOON_AGAIN, _DATA = 0, 3, 1  # arguments of llvm.prefetch


@intrinsic
def prefetch(_typing: Any, array: Any, index: Any) -> Any:
    """Prefetch the cache line of an item of an array (n,) without waiting: prefetch(array, index).

    An index beyond the array is harmless.
    """

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.args[0]
        made = context.make_array(kind)(context, builder, arguments[0])
        item = cgutils.get_item_pointer(context, builder, kind, made, [arguments[1]])
        line = builder.bitcast(item, ir.IntType(8).as_pointer())
        word = ir.IntType(32)
        shape = ir.FunctionType(ir.VoidType(), [line.type, word, word, word])
        function = builder.module.declare_intrinsic("llvm.prefetch", [line.type], shape)
        builder.call(function, [line, word(_READ), word(_SOON_AGAIN), word(_DATA)])
        return context.get_dummy_value()

    flat = isinstance(array, types.Array) and array.ndim == 1
    return (types.none(array, types.int64), build) if flat and isinstance(index, types.Integer) else None
