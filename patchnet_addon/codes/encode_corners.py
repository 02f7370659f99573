# SPDX-License-Identifier: GPL-3.0-or-later
"""Encode corners with compiled code in one pass: each core computes the codes of chunks of corners.

A chunk's blocks are filled once for each voxel around its corners. A voxel in one octant of a corner lies in that
octant of no other, so each pair of a non-empty voxel and an octant is one product, and only needed products are
computed. In each octant, pairs whose voxels have the same cells are adjacent, for `network/product.py`, and products
are added to the first layer's sums in place. All data of a chunk fits the nearest caches.

Cores synchronize only after a range of corners. Sums take their terms in the same order, independent of the chunk.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..network.encoders import CHANNELS, LUMINANCE
from ..network.kinds import CODE_SIZE
from ..network.product import ROWS, WIDTH, PackedLayers, find_steps, sum_products, write_sums
from ..network.simd import LANES, load, zeros
from ..octree.leaf_boxes import filled_share
from ..octree.octree import LUMINANCE_SCALE, NORMAL_SCALE, Octree
from ..runtime.bits import lowest_one
from ..runtime.kernels import device, kernel
from ..runtime.threads import run_parts
from ..runtime.vectors import larger, store
from .brick import covering_node, fill_block

_TILES = 32  # with steps stored at a time
_CHUNKS = {1: 512, 2: 512, 3: 128}  # corners at a time by look-ahead: their blocks and sums fit a core's second cache
_SLOTS = 16  # slots of the table of voxels per corner


class Cells(NamedTuple):
    """Octree arrays to fill blocks from: `BoxedNodes`, with their luminance (n,) uint16 and normal (n, 3) int8."""

    child_mask: np.ndarray
    first_child: np.ndarray
    first_boxed: int
    boxes: np.ndarray
    luminance: np.ndarray
    normal: np.ndarray


class _Voxels(NamedTuple):
    """Distinct non-empty voxels around a chunk of S corners.

    node: (8 S,) int64. table: (16 S,) int32 hash table of their numbers, -1 where empty. block: (8 S, B) float32,
    z, y, x, channel. used: (8 S, B / 64) uint64, bits of their non-zero values. key: (8 S,) uint64, equal for equal
    occupied cells. first: (8 S, 8) int32, a corner with the voxel in each octant, -1 for none.
    next: (S, 8) int32, another corner with the same voxel there, -1 for none: coarser leaves adjoin many corners.
    """

    node: np.ndarray
    table: np.ndarray
    block: np.ndarray
    used: np.ndarray
    key: np.ndarray
    first: np.ndarray
    next: np.ndarray


def encode_corners(
    octree: Octree, level: int, corners: np.ndarray, layers: PackedLayers, lookahead: int, chunk: int | None = None
) -> np.ndarray:
    """Codes (C, 10) float32 of corners (C, 3) int32 of a level; `chunk`, the number at a time, affects only speed."""
    chunk = chunk or _CHUNKS[lookahead]
    codes = np.empty((len(corners), CODE_SIZE), np.float32)
    cells = Cells(*octree.boxed_nodes, octree.luminance, octree.normal)
    run_parts(_encode, -(-len(corners) // chunk), cells, (level, lookahead), corners, layers, chunk, codes)
    return codes


@kernel
def _encode(first, last, cells, levels, corners, layers, size, codes):  # type: ignore[no-untyped-def]
    """Encode chunks of `size` corners."""
    level, lookahead = levels
    voxels = _make_voxels(size, lookahead)
    hidden = len(layers.first_bias)
    sums, other = np.empty((size + 1, hidden), np.float32), np.empty((size + 1, hidden), np.float32)
    for start in range(first * size, min(last * size, len(corners)), size):
        here = corners[start : min(start + size, len(corners))]
        count = _find_voxels(cells, level, here, voxels)
        _fill_blocks(cells, lookahead, count, layers.sees_luminance, voxels)
        _sum_octants(voxels, len(here), count, layers.octants, layers.first_bias, sums)
        _run_layers(layers, len(here), sums, other, codes[start:])


@device
def _make_voxels(size, lookahead):  # type: ignore[no-untyped-def]
    slots = 1
    while slots < _SLOTS * size:
        slots *= 2
    depth = CHANNELS << (3 * lookahead)
    return _Voxels(
        np.empty(8 * size, np.int64),
        np.empty(slots, np.int32),
        np.empty((8 * size, depth), np.float32),
        np.empty((8 * size, (depth + 63) // 64), np.uint64),
        np.empty(8 * size, np.uint64),
        np.empty((8 * size, 8), np.int32),
        np.empty((size, 8), np.int32),
    )


@device
def _find_voxels(nodes, level, corners, voxels):  # type: ignore[no-untyped-def]
    """List the non-empty voxels around corners; returns their number."""
    node, table, first, following = voxels.node, voxels.table, voxels.first, voxels.next
    around = np.empty(8, np.int64)
    table[:] = -1
    count = 0
    for corner in range(len(corners)):
        x, y, z = np.int64(corners[corner, 0]), np.int64(corners[corner, 1]), np.int64(corners[corner, 2])
        follows = corner > 0 and corners[corner - 1, 0] + 1 == x
        follows = follows and corners[corner - 1, 1] == y and corners[corner - 1, 2] == z
        for octant in range(8):
            if follows and octant & 1 == 0:  # the right voxels of the previous corner are the left ones of this
                around[octant] = around[octant + 1]
            else:
                column, line, plane = octant & 1, (octant >> 1) & 1, octant >> 2
                around[octant] = covering_node(nodes, 0, level, x - 1 + column, y - 1 + line, z - 1 + plane)
            if around[octant] < 0:
                continue
            voxel = _find_slot(table, node, around[octant], count)
            if voxel == count:
                node[count] = around[octant]
                first[count] = -1
                count += 1
            following[corner, octant] = first[voxel, octant]
            first[voxel, octant] = corner
    return count


@device
def _find_slot(table, nodes, node, count):  # type: ignore[no-untyped-def]
    """Return the number of a node's voxel; a new one is added as number `count`."""
    mixed = np.uint64(node) * np.uint64(0x9E3779B97F4A7C15)
    slot = np.int64((mixed >> np.uint64(32)) & np.uint64(len(table) - 1))
    while table[slot] >= 0:
        if nodes[table[slot]] == node:
            return np.int64(table[slot])
        slot = (slot + 1) & (len(table) - 1)
    table[slot] = count
    return np.int64(count)


@device
def _fill_blocks(cells, lookahead, count, with_luminance, voxels):  # type: ignore[no-untyped-def]
    """Fill the blocks of `count` voxels, the bits of their non-zero values, and their keys.

    Luminance without effect is set to 0, so that it takes no products.
    """
    luminance, normal, side = cells.luminance, cells.normal, 1 << lookahead
    first_boxed, boxes = cells.first_boxed, cells.boxes
    luminance_scale, normal_scale = np.float32(LUMINANCE_SCALE), np.float32(NORMAL_SCALE)
    inner = np.empty(side**3, np.int32)
    values = np.empty(CHANNELS, np.float32)
    for voxel in range(count):
        fill_block(cells, voxels.node[voxel], lookahead, inner)
        block, used = voxels.block[voxel], voxels.used[voxel]
        block[:] = np.float32(0)
        used[:] = np.uint64(0)
        key = np.uint64(0)
        for cell in range(len(inner)):
            node = inner[cell]
            if node < 0:
                continue
            values[0] = filled_share(boxes, node - first_boxed) if node >= first_boxed else np.float32(1)
            values[LUMINANCE] = np.float32(luminance[node]) / luminance_scale if with_luminance else np.float32(0)
            for axis in range(3):
                values[2 + axis] = np.float32(normal[node, axis]) / normal_scale
            key |= np.uint64(1) << np.uint64(63 - _coarse(cell, side))
            for channel in range(CHANNELS):
                column = CHANNELS * cell + channel
                block[column] = values[channel]
                if values[channel] != 0:
                    used[column >> 6] |= np.uint64(1) << np.uint64(column & 63)
        voxels.key[voxel] = key


@device
def _coarse(cell, side):  # type: ignore[no-untyped-def]
    """Number of the part, of 4x4x4 in a block, that holds a cell; of the cell itself in smaller blocks."""
    if side <= 4:
        return cell
    x, y, z = cell % side, cell // side % side, cell // (side * side)
    return 4 * x // side + 4 * (4 * y // side + 4 * (4 * z // side))


@device
def _sum_octants(voxels, corners, count, octants, bias, sums):  # type: ignore[no-untyped-def]
    """First layer with ReLU: sums (S + 1, 256) of the products of each corner's voxels; the last row is padding."""
    width = len(bias)
    for corner in range(corners):
        for column in range(0, width, LANES):  # by hand: a row assignment adds three seconds of compilation
            store(sums, corner * width + column, load(bias, column))
    order = _order(voxels.key, count)
    pairs = np.empty((corners + ROWS, 2), np.int64)  # voxel and corner
    panels = width // WIDTH
    for octant in range(8):
        found = 0
        for voxel in order:
            corner = voxels.first[voxel, octant]
            while corner >= 0:
                pairs[found, 0], pairs[found, 1] = voxel, corner
                found += 1
                corner = voxels.next[corner, octant]
        tiles = (found + ROWS - 1) // ROWS
        for more in range(found, ROWS * tiles):
            pairs[more, 0], pairs[more, 1] = pairs[found - 1, 0], len(sums) - 1
        first, last = octant * panels, (octant + 1) * panels
        for tile in range(0, tiles, _TILES):
            some = pairs[ROWS * tile : ROWS * min(tile + _TILES, tiles)]
            _add_products(voxels.block, voxels.used, some, octants[first:last], sums)
    for corner in range(corners):
        for column in range(0, width, LANES):
            place = corner * width + column
            store(sums, place, larger(zeros(), load(sums, place)))


@device
def _order(keys, count):  # type: ignore[no-untyped-def]
    """Order (count,) of ascending keys by merge sort; `np.argsort` adds 1.5 s of compilation."""
    order, other = np.arange(count), np.empty(count, np.int64)
    width = 1
    while width < count:
        for start in range(0, count, 2 * width):
            left, right = start, min(start + width, count)
            middle, end = right, min(start + 2 * width, count)
            for place in range(start, end):
                if right == end or (left < middle and keys[order[left]] <= keys[order[right]]):
                    other[place] = order[left]
                    left += 1
                else:
                    other[place] = order[right]
                    right += 1
        order, other = other, order
        width *= 2
    return order


@device
def _add_products(blocks, used, pairs, panels, sums):  # type: ignore[no-untyped-def]
    """Add the products of pairs (4 T, 2) of a block and a row of the sums, tiles of four, with an octant's panels."""
    tiles = len(pairs) // ROWS
    steps = np.empty((_TILES, blocks.shape[1]), np.uint16)
    counts = np.empty(_TILES, np.int64)
    nothing = np.zeros(sums.shape[1], np.float32)
    for tile in range(tiles):
        counts[tile] = _used_columns(used, pairs[ROWS * tile : ROWS * tile + ROWS, 0], steps[tile])
    for panel in range(len(panels)):
        for tile in range(tiles):
            four = pairs[ROWS * tile : ROWS * tile + ROWS]
            products = sum_products(blocks, four[:, 0], steps[tile], counts[tile], panels, panel, nothing)
            for row in range(ROWS):
                place = four[row, 1] * sums.shape[1] + panel * WIDTH
                store(sums, place, load(sums, place) + products[2 * row])
                store(sums, place + LANES, load(sums, place + LANES) + products[2 * row + 1])


@device
def _used_columns(used, four, steps):  # type: ignore[no-untyped-def]
    """Write the columns that are not zero in all of four blocks into `steps`, ascending; returns their number."""
    count = 0
    for word in range(used.shape[1]):
        bits = used[four[0], word] | used[four[1], word] | used[four[2], word] | used[four[3], word]
        while bits != 0:
            steps[count] = 64 * word + lowest_one(bits)
            count += 1
            bits &= bits - np.uint64(1)
    return count


@device
def _run_layers(layers, corners, values, other, codes):  # type: ignore[no-untyped-def]
    """Run the layers after the first on values (S + 1, 256), and write the codes (C, 10); `other`: scratch like the
    values.

    Rows are padded to a whole tile with arbitrary values.
    """
    width = values.shape[1]
    panels, last_panels = width // WIDTH, (CODE_SIZE + WIDTH - 1) // WIDTH
    first = 0
    while first < len(layers.panels):
        is_last = first + last_panels == len(layers.panels)
        end = first + (last_panels if is_last else panels)
        bias = layers.bias[first * WIDTH : end * WIDTH]
        for row in range(0, corners, ROWS * _TILES):
            rows = (row, min(row + ROWS * _TILES, corners))
            _multiply_rows(values, rows, layers.panels[first:end], bias, layers.least[int(is_last) :], other)
        values, other = other, values
        first = end
    for corner in range(corners):
        for column in range(CODE_SIZE):
            codes[corner, column] = values[corner, column]


@device
def _multiply_rows(values, rows, panels, bias, least, result):  # type: ignore[no-untyped-def]
    """Multiply rows `first` to `last` of the values; incomplete tiles repeat the last row."""
    bits = values.view(np.int32)
    first, last = rows
    tiles = (last - first + ROWS - 1) // ROWS
    steps = np.empty((_TILES, values.shape[1] + 1), np.uint16)
    counts = np.empty(_TILES, np.int64)
    four = np.empty((_TILES, ROWS), np.int64)
    for tile in range(tiles):
        for row in range(ROWS):
            four[tile, row] = min(first + ROWS * tile + row, last - 1)
        counts[tile] = find_steps(bits, four[tile], steps[tile])
    for panel in range(len(panels)):
        for tile in range(tiles):
            sums = sum_products(values, four[tile], steps[tile], counts[tile], panels, panel, bias)
            write_sums(result, four[tile], panel, sums, least)
