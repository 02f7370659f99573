# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batches: the occupied blocks around V voxels, and R views of each, optionally augmented.

Only occupied blocks are gathered. A corner's patch is eight blocks, each multiplied with its own slice of the first
matrix, so a batch lists which block meets which slice for which corner (see `corner_layer.py`). The kernels are serial,
since several threads gather, and learn from, a part of a step each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from ...patchnet_addon.codes.brick import Brick, empty_brick, fill_blocks, nodes_around
from ...patchnet_addon.codes.mixture_inputs import nearby_order
from ...patchnet_addon.codes.outer_cells import mask_geometry
from ...patchnet_addon.network.kinds import COVERING, MIXED, VIEW
from ...patchnet_addon.network.weights import CHANNELS
from ...patchnet_addon.octree.leaf_boxes import filled_share
from ...patchnet_addon.octree.octree import LUMINANCE_SCALE, NORMAL_SCALE
from ...patchnet_addon.runtime.bits import lowest_one
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.kernels import device, kernel, lean_device
from .bfloat16 import narrow_bits
from .block_words import TOGETHER, occupied_cells, write_words
from .fetch_ahead import AHEAD, fetch_cells, fetch_children, fetch_nodes
from .forest import Forest, tree_nodes
from .nearby import Nearby, gather_nearby
from .stored_views import read_views, turn_views
from .symmetry import COUNT, Symmetries, cube_symmetries

PAIR_POSITION = np.array(
    [[sum(((c >> axis & 1) + (s >> axis & 1)) * 3**axis for axis in range(3)) for c in range(8)] for s in range(8)],
    np.int32,
)  # (slice, corner) -> block of the brick


@dataclass(frozen=True, eq=False)
class Batch:
    """V voxels with R views each.

    blocks: (M, B) float32, the occupied blocks of all voxels; cells z, y, x of occupancy, luminance, normal, B = 320
    for a look-ahead of two levels. For networks that mix luminances, which see shape alone, it is left out, B = 256.
    uint16 is the bits of bfloat16, for encoders whose products are of that type.
    slice_start: (9,) int64; pairs slice_start[s] to slice_start[s + 1] meet slice s (octant x + 2y + 4z of the patch).
    pair_block: (P,) int64 rows of `blocks`. pair_corner: (P,) int64 corner 8 v + c that the pair adds to.
    entry, direction, up: (V, R, 3) float32. ratio, coverage, luminance: (V, R) float32.
    nearby: for networks that mix luminances.
    """

    blocks: np.ndarray
    slice_start: np.ndarray
    pair_block: np.ndarray
    pair_corner: np.ndarray
    entry: np.ndarray
    direction: np.ndarray
    up: np.ndarray
    ratio: np.ndarray
    coverage: np.ndarray
    luminance: np.ndarray
    nearby: Nearby | None = field(default=None, kw_only=True)


@dataclass(frozen=True, eq=False)
class Augmentation:
    """Augmentation of each of V voxels.

    symmetry: (V,) int32 number of the cube symmetry, 0 for none.
    remap: (V, 4) float32: gain, place of the result in its free range [0, 1], 1 to invert, 1 to remap at all.
    """

    symmetry: np.ndarray
    remap: np.ndarray

    @classmethod
    def none(cls, count: int) -> Augmentation:
        """Leave `count` voxels as they are."""
        return cls(np.zeros(count, np.int32), np.zeros((count, 4), np.float32))

    @classmethod
    def random(cls, count: int, random: np.random.Generator, remap_share: float = 0.5) -> Augmentation:
        """Random symmetry for each voxel, and for a share of them another range of luminance (methods 7.20)."""
        remap = random.random((count, 4), np.float32)
        remap[:, 0] += 0.5
        remap[:, 2] = remap[:, 2] < 0.5
        remap[:, 3] = remap[:, 3] < remap_share
        return cls(random.integers(0, COUNT, count).astype(np.int32), remap)

    def part(self, first: int, last: int) -> Augmentation:
        """Augmentation of the voxels `first` to `last`, the last one excluded."""
        return Augmentation(self.symmetry[first:last], self.remap[first:last])


def block_values(lookahead: int, *, nearby: bool) -> int:
    """Numbers B of a block, see `Batch`; nearby: of networks that mix luminances."""
    return (CHANNELS - 1 if nearby else CHANNELS) * 8**lookahead


@cache
def _symmetries(lookahead: int) -> Symmetries:
    return cube_symmetries(lookahead)


def gather_batch(
    forest: Forest,
    tree: np.ndarray,
    voxel: np.ndarray,
    views: np.ndarray,
    augmentation: Augmentation,
    lookahead: int = DEFAULT_LOOKAHEAD,
    *,
    nearby: bool = False,
    narrow: bool = False,
) -> Batch:
    """Batch of voxels (V, 4) of octrees `tree` (V,) with their stored views (V, R, 12), drawn `lookahead` levels
    ahead; `nearby`: with the luminances that a mixture needs; `narrow`: with blocks in bits of bfloat16."""
    width = block_values(lookahead, nearby=nearby)
    stored = np.ascontiguousarray(tree, np.int32), np.ascontiguousarray(voxel, np.uint16), np.ascontiguousarray(views)
    blocks, pairs, rays, near = _gather(
        (forest.nodes, forest.luminance, forest.normal, forest.root),
        stored,
        (augmentation.remap, augmentation.symmetry, _symmetries(lookahead)),
        (lookahead, width, narrow, nearby),
        (PAIR_POSITION, mask_geometry(), nearby_order()),
    )
    found = Nearby(*near) if nearby else None
    return Batch(blocks[1] if narrow else blocks[0], *pairs, *rays, nearby=found)


@kernel
def _gather(forest, stored, augmentation, how, tables):
    """Gather a batch by one call, since each of Python's steps in between would find its own code in no cache."""
    nodes, luminance, normal, root = forest
    trees, voxels, views = stored
    _, symmetry, symmetries = augmentation
    lookahead, width, narrow, nearby = how
    position, geometry, orders = tables
    count = len(trees)
    tree, voxel = trees.astype(np.int64), voxels.astype(np.int32)
    linear = np.empty((count, 2), np.float32)  # gain and offset of luminance
    most = 27 * count
    blocks = np.empty((0 if narrow else most, width), np.float32)
    bits = np.empty((most if narrow else 0, width), np.uint16)
    words = bits.view(np.int64) if nearby else np.empty((0, 0), np.int64)  # a cell of four numbers at once
    moved = np.full((count, 27), -1, np.int32)  # rows of `blocks` by position after the symmetry
    around = np.empty((count, 27), np.int32)
    where, cells_of = (root, tree, voxel), (luminance, normal)
    found = blocks, bits, words
    rows = _gather_blocks(nodes, cells_of, where, augmentation, lookahead, not nearby, found, moved, around, linear)
    pairs = _list_pairs(moved, position)
    entry, direction, up, ratio, coverage, light = read_views(views)
    near_views = views.shape[1] if nearby else 0
    near = (
        np.empty((count, near_views, VIEW), np.float32),
        np.empty((count, near_views, COVERING), np.float32),
        np.empty((count, near_views, MIXED), np.float32),
    )
    if nearby:
        rays = entry, direction, up, ratio
        gather_nearby(nodes, luminance, (tree, around, linear), rays, (geometry, orders), near)
    turn_views((entry, direction, up), light, (symmetry, symmetries), linear)
    return (blocks[:rows], bits[:rows]), pairs, (entry, direction, up, ratio, coverage, light), near


@device
def _gather_blocks(nodes, cells_of, voxels, augmentation, lookahead, with_luminance, found, moved, around, linear):
    """Write each occupied block as a row of whichever of `found` has rows: float32, or the bits of bfloat16.

    Third among them are words, the bits of a cell's four numbers at once, for networks that mix luminances. Returns how
    many rows there are. around: (V, 27) what the voxels' bricks have of that name.
    """
    luminance, normal = cells_of
    root, tree, voxel = voxels
    remap, symmetry, symmetries = augmentation
    empty = empty_brick(lookahead)
    values = np.empty(found[0].shape[1], np.float32)
    row = 0
    normals = normal.reshape(-1)
    for step in range(len(tree) + 3 * AHEAD):
        children, cells, v = step - AHEAD, step - 2 * AHEAD, step - 3 * AHEAD
        if step < len(tree):
            nodes_around(nodes, root[tree[step]], voxel[step, 0], voxel[step, 1:], around[step])
            fetch_nodes(nodes, around[step])
        if 0 <= children < len(tree):
            fetch_children(nodes, around[children])
        if 0 <= cells < len(tree):
            fetch_cells(nodes, normals, 3, around[cells])
            if with_luminance or remap[cells, 3] > 0:
                fetch_cells(nodes, luminance, 1, around[cells])
        if v < 0:
            continue
        own, brick = tree_nodes(nodes, tree[v]), Brick(empty.nodes, empty.counts, around[v])
        fill_blocks(own, lookahead, brick)
        _remap(luminance, brick, remap[v], linear[v])
        light = np.float32(linear[v, 0] / np.float32(LUMINANCE_SCALE)), linear[v, 1], with_luminance
        row = _write_brick(own, luminance, normal, brick, light, symmetry[v], symmetries, values, found, moved[v], row)
    return row


@lean_device
def _remap(luminance, brick, remap, linear):
    """Write gain and offset of a voxel's luminances into `linear` (2,); remap: as in `Augmentation`."""
    linear[0], linear[1] = 1.0, 0.0
    if remap[3] == 0:
        return
    nodes, counts = brick.nodes, brick.counts
    low, high, cells = LUMINANCE_SCALE, 0.0, nodes.shape[1]
    for block in range(27):
        for first in range(0, cells if counts[block] > 0 else 0, TOGETHER):
            left = occupied_cells(nodes, block * cells + first, cells - first)
            while left != 0:
                light = luminance[nodes[block, first + lowest_one(left)]]
                left &= left - 1
                low, high = min(low, light), max(high, light)
    dark, bright = low / LUMINANCE_SCALE, high / LUMINANCE_SCALE
    gain = min(remap[0], 1.0 / max(bright - dark, 1e-6))
    place = remap[1] * (1.0 - gain * (bright - dark))  # the darkest cell's new luminance
    if remap[2] > 0:  # inverted: the brightest cell becomes the darkest
        linear[0], linear[1] = -gain, place + gain * bright
    else:
        linear[0], linear[1] = gain, place - gain * dark


@lean_device
def _write_brick(own, luminance, normal, brick, light, turn, symmetries, values, found, moved, row):
    """Write the blocks of one voxel from `row` on, list their rows in `moved`; returns the row after them."""
    blocks, bits, words = found
    to_block = symmetries.block[turn]
    turned = symmetries.axis[turn], symmetries.sign[turn], symmetries.cell[turn]
    for block in range(27):
        if brick.counts[block] == 0:
            continue
        moved[to_block[block]] = row
        if len(words):
            write_words(own, normal, brick, block, turned, words[row])
        else:
            _write_values(own, luminance, normal, brick, block, light, turned, values)
            if len(bits):
                for k in range(len(values)):
                    bits[row, k] = narrow_bits(values[k])
            else:
                for k in range(len(values)):
                    blocks[row, k] = values[k]
        row += 1
    return row


@lean_device
def _write_values(own, luminance, normal, brick, block, light, turned, values):
    """Write the cells of a block into `values` (B,); reference of `write_words`."""
    gain, offset, with_luminance = light
    axis, sign, to_cell = turned
    nodes, first_boxed, boxes = brick.nodes, own.first_boxed, own.boxes
    ax, ay, az = axis[0], axis[1], axis[2]
    scale = np.float32(1.0 / NORMAL_SCALE)
    channels = CHANNELS if with_luminance else CHANNELS - 1
    sx, sy, sz = sign[0] * scale, sign[1] * scale, sign[2] * scale
    for k in range(len(values)):
        values[k] = 0
    for cell in range(nodes.shape[1]):
        node = nodes[block, cell]
        if node < 0:
            continue
        at = channels * to_cell[cell]
        values[at] = filled_share(boxes, node - first_boxed) if node >= first_boxed else np.float32(1)
        if with_luminance:
            values[at + 1] = gain * luminance[node] + offset
        at += channels - 3
        values[at] = sx * normal[node, ax]
        values[at + 1] = sy * normal[node, ay]
        values[at + 2] = sz * normal[node, az]


@device
def _list_pairs(moved, position):
    start = np.zeros(9, np.int64)
    total = 0
    for v in range(len(moved)):
        for s in range(8):
            for c in range(8):
                total += moved[v, position[s, c]] >= 0
    pair_block, pair_corner = np.empty(total, np.int64), np.empty(total, np.int64)
    at = 0
    for s in range(8):
        for v in range(len(moved)):
            for c in range(8):
                row = moved[v, position[s, c]]
                if row >= 0:
                    pair_block[at] = row
                    pair_corner[at] = 8 * v + c
                    at += 1
        start[s + 1] = at
    return start, pair_block, pair_corner
