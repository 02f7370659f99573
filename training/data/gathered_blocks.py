# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of fine cells around training voxels, gathered from octrees into the rows that an encoder learns from.

The occupied cells of a brick are listed first, and then written, so that what is empty costs the clearing of a row and
no more. Values are float32, or the bits of bfloat16 for encoders whose products are of that type.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...patchnet_addon.codes.brick import nodes_around
from ...patchnet_addon.network.encoders import CHANNELS
from ...patchnet_addon.octree.leaf_boxes import filled_share
from ...patchnet_addon.octree.octree import LUMINANCE_SCALE, NORMAL_SCALE
from ...patchnet_addon.runtime.bits import lowest_one
from ...patchnet_addon.runtime.kernels import device, kernel, lean_device
from .bfloat16 import narrow_bits
from .forest import Forest, tree_nodes
from .symmetry import Symmetries

BLOCKS = 27  # of a brick
_ALL = np.int64(255)  # the child mask that a leaf counts as: it is all of its children


class GatheredBlocks(NamedTuple):
    """Occupied blocks around V voxels.

    rows: (M, B) float32, or uint16 bits of bfloat16; see `Batch.blocks`. moved: (V, 27) int32, the row of each block by
    its place after the symmetry, -1 for an empty one. around: (V, 27) int32, see `Brick`. linear: (V, 2) float32, gain
    and offset that luminance is changed by.
    """

    rows: np.ndarray
    moved: np.ndarray
    around: np.ndarray
    linear: np.ndarray


class _Listed(NamedTuple):
    """Occupied cells of a brick, and memory to list them with.

    nodes, cells: (27 * 8^n,) int32, node and place in its block of each. start: (28,) int32, where those of each block
    begin. inner: (2, 2, 8^n) int32, nodes and places of what is divided next, two in turns.
    """

    nodes: np.ndarray
    cells: np.ndarray
    start: np.ndarray
    inner: np.ndarray


def gather_blocks(
    forest: Forest,
    voxels: tuple[np.ndarray, np.ndarray],
    augmentation: tuple[np.ndarray, np.ndarray],
    symmetries: Symmetries,
    lookahead: int,
    *,
    luminance: bool,
    narrow: bool,
) -> GatheredBlocks:
    """Blocks of voxels, which are octrees (V,) and level and cell in these (V, 4), `lookahead` levels ahead.

    augmentation: symmetry (V,) and remap (V, 4), see `Augmentation`. luminance: whether cells have theirs, between
    occupancy and normal. narrow: in bits of bfloat16.
    """
    tree, voxel = voxels
    count, width = len(tree), (CHANNELS if luminance else CHANNELS - 1) * 8**lookahead
    rows = np.empty((BLOCKS * count, width), np.uint16 if narrow else np.float32)
    none = np.empty((0, width), np.float32 if narrow else np.uint16)
    moved = np.full((count, BLOCKS), -1, np.int32)
    around = np.empty((count, BLOCKS), np.int32)
    linear = np.empty((count, 2), np.float32)
    found = _gather(
        forest.nodes,
        (forest.luminance, forest.normal),
        (forest.root, tree.astype(np.int64), voxel.astype(np.int32)),
        (*augmentation, symmetries),
        (lookahead, luminance),
        (none, rows) if narrow else (rows, none),
        (moved, around, linear),
    )
    return GatheredBlocks(rows[:found], moved, around, linear)


@kernel
def _gather(nodes, cells, voxels, augmentation, seen, found, results):
    """Write each occupied block as a row of whichever of `found` has any; returns how many there are."""
    luminance, normal = cells
    root, tree, voxel = voxels
    symmetry, remap, symmetries = augmentation
    lookahead, with_luminance = seen
    moved, around, linear = results
    listed = _empty_list(lookahead)
    row = 0
    for v in range(len(tree)):
        own, place = tree_nodes(nodes, tree[v]), voxel[v]
        nodes_around(own, root[tree[v]], place[0], place[1:], around[v])
        _list_cells(own, around[v], lookahead, listed)
        _remap(luminance, listed, remap[v], linear[v])
        light = np.float32(linear[v, 0] / np.float32(LUMINANCE_SCALE)), linear[v, 1], with_luminance
        row = _write(own, luminance, normal, listed, light, symmetry[v], symmetries, found, moved[v], row)
    return row


@device
def _empty_list(lookahead):
    size = 1 << 3 * lookahead
    return _Listed(
        np.empty(BLOCKS * size, np.int32),
        np.empty(BLOCKS * size, np.int32),
        np.empty(BLOCKS + 1, np.int32),
        np.empty((2, 2, size), np.int32),
    )


@lean_device
def _list_cells(nodes, around, lookahead, listed):
    """List the occupied cells of the blocks of nodes `around` (27,), block by block."""
    masks, first_children = nodes.child_mask, nodes.first_child
    found_nodes, found_cells, start, inner = listed.nodes, listed.cells, listed.start, listed.inner
    side = 1 << lookahead
    total = 0
    for block in range(BLOCKS):
        start[block] = total
        if around[block] < 0:
            continue
        count, turn, half = 1, 0, side >> 1
        inner[0, 0, 0], inner[0, 1, 0] = around[block], 0
        while half > 1:
            before, after = inner[turn], inner[1 - turn]
            count = _divide(masks, first_children, side, half, before, count, after[0], after[1])
            turn, half = 1 - turn, half >> 1
        here = found_nodes[total:], found_cells[total:]
        total += _divide(masks, first_children, side, half, inner[turn], count, *here)
    start[BLOCKS] = total


@lean_device
def _divide(masks, first_children, side, half, before, count, nodes, cells):
    """List the children of nodes, `half` cells wide each, and return how many they are.

    before: (2, n) nodes and their first cells, of which there are `count`.
    """
    found = 0
    for k in range(count):
        node, cell = np.int64(before[0, k]), np.int64(before[1, k])
        mask, child, step = np.int64(masks[node]), np.int64(first_children[node]), 1
        if mask == 0:
            mask, child, step = _ALL, node, 0
        while mask != 0:
            octant = lowest_one(mask)
            mask &= mask - 1
            nodes[found] = child
            cells[found] = cell + half * ((octant & 1) + side * (((octant >> 1) & 1) + side * (octant >> 2)))
            child += step
            found += 1
    return found


@lean_device
def _remap(luminance, listed, remap, linear):
    """Write gain and offset of a voxel's luminances into `linear` (2,); remap: as in `Augmentation`."""
    linear[0], linear[1] = 1.0, 0.0
    if remap[3] == 0:
        return
    nodes = listed.nodes
    low, high = LUMINANCE_SCALE, 0.0
    for k in range(listed.start[BLOCKS]):
        low = min(low, luminance[nodes[k]])
        high = max(high, luminance[nodes[k]])
    dark, bright = low / LUMINANCE_SCALE, high / LUMINANCE_SCALE
    gain = min(remap[0], 1.0 / max(bright - dark, 1e-6))
    place = remap[1] * (1.0 - gain * (bright - dark))  # the darkest cell's new luminance
    if remap[2] > 0:  # inverted: the brightest cell becomes the darkest
        linear[0], linear[1] = -gain, place + gain * bright
    else:
        linear[0], linear[1] = gain, place - gain * dark


@lean_device
def _write(own, luminance, normal, listed, light, turn, symmetries, found, moved, row):
    """Write the blocks of one voxel from `row` on, list their rows in `moved`; returns the row after them."""
    wide, narrow = found
    to_block, to_cell = symmetries.block[turn], symmetries.cell[turn]
    start = listed.start
    axes = symmetries.axis[turn], symmetries.sign[turn]
    for block in range(BLOCKS):
        first, last = start[block], start[block + 1]
        if first == last:
            continue
        moved[to_block[block]] = row
        here = listed.nodes[first:last], listed.cells[first:last], to_cell
        if len(narrow):
            _write_narrow_row(own, luminance, normal, here, light, axes, narrow[row])
        else:
            _write_row(own, luminance, normal, here, light, axes, wide[row])
        row += 1
    return row


@lean_device
def _write_row(own, luminance, normal, listed, light, axes, values):
    """Write a block in float32."""
    nodes, cells, to_cell = listed
    channels = CHANNELS if light[2] else CHANNELS - 1
    values[:] = 0
    for k in range(len(nodes)):
        at = channels * to_cell[cells[k]]
        occupancy, shown, x, y, z = _cell_values(own, luminance, normal, np.int64(nodes[k]), light, axes)
        if light[2]:
            values[at + 1] = shown
        values[at] = occupancy
        at += channels
        values[at - 3], values[at - 2], values[at - 1] = x, y, z


@lean_device
def _write_narrow_row(own, luminance, normal, listed, light, axes, bits):
    """Write a block in bits of bfloat16."""
    nodes, cells, to_cell = listed
    channels = CHANNELS if light[2] else CHANNELS - 1
    bits[:] = 0
    for k in range(len(nodes)):
        at = channels * to_cell[cells[k]]
        occupancy, shown, x, y, z = _cell_values(own, luminance, normal, np.int64(nodes[k]), light, axes)
        if light[2]:
            bits[at + 1] = narrow_bits(shown)
        bits[at] = narrow_bits(occupancy)
        at += channels
        bits[at - 3], bits[at - 2], bits[at - 1] = narrow_bits(x), narrow_bits(y), narrow_bits(z)


@lean_device
def _cell_values(own, luminance, normal, node, light, axes):
    """Occupancy, luminance and normal of a cell, after the augmentation; luminance 0 where it is not asked for."""
    gain, offset, with_luminance = light
    axis, sign = axes
    scale = np.float32(1.0 / NORMAL_SCALE)
    occupancy = filled_share(own.boxes, node - own.first_boxed) if node >= own.first_boxed else np.float32(1)
    shown = np.float32(gain * luminance[node] + offset) if with_luminance else np.float32(0)
    x = sign[0] * scale * normal[node, axis[0]]
    y = sign[1] * scale * normal[node, axis[1]]
    return occupancy, shown, x, y, sign[2] * scale * normal[node, axis[2]]
