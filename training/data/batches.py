# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batches: the occupied blocks around V voxels, and R views of each, optionally augmented.

A corner's patch is eight blocks, shared by the corners of a voxel: a batch stores each block once, with the eight
indices of each corner's patch. The kernels are serial, since several threads gather batches at the same time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...patchnet_addon.codes.brick import Brick, empty_brick, fill_blocks, nodes_around
from ...patchnet_addon.codes.mixture_inputs import nearby_order
from ...patchnet_addon.codes.outer_cells import mask_geometry
from ...patchnet_addon.network.kinds import COVERING, MIXED, VIEW
from ...patchnet_addon.network.weights import CHANNELS
from ...patchnet_addon.octree.leaf_boxes import filled_share
from ...patchnet_addon.octree.octree import LUMINANCE_SCALE, NORMAL_SCALE
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.kernels import device, kernel, lean_device
from .augmentation import Augmentation, cube_symmetries
from .forest import Forest, tree_nodes
from .nearby import Nearby, gather_nearby
from .samples import COVERAGE_SCALE, SIGNED, UNIT

BLOCK_POSITION = np.array(
    [[sum(((c >> axis & 1) + (o >> axis & 1)) * 3**axis for axis in range(3)) for o in range(8)] for c in range(8)],
    np.int32,
)  # (corner, octant of its patch) -> block of the brick


@dataclass(frozen=True, eq=False)
class Batch:
    """V voxels with R views each, in arrays of NumPy or tensors of torch.

    blocks: (M + 1, B) float32, an empty block and the M occupied ones of all voxels; cells z, y, x of occupancy,
    luminance, normal, B = 320 for a look-ahead of two levels. For networks that mix luminances, which see shape alone,
    luminance is left out, B = 256.
    rows: (8 V, 8) int64, the blocks of each corner's patch, octants x fastest; 0 where the octant is empty.
    entry, direction, up: (V, R, 3) float32. ratio, coverage, luminance: (V, R) float32.
    nearby: for networks that mix luminances.
    """

    blocks: Any
    rows: Any
    entry: Any
    direction: Any
    up: Any
    ratio: Any
    coverage: Any
    luminance: Any
    nearby: Nearby | None = field(default=None, kw_only=True)


def block_values(lookahead: int, *, nearby: bool) -> int:
    """Numbers B of a block, see `Batch`; nearby: of networks that mix luminances."""
    return (CHANNELS - 1 if nearby else CHANNELS) * 8**lookahead


def gather_batch(
    forest: Forest,
    tree: np.ndarray,
    voxel: np.ndarray,
    views: np.ndarray,
    augmentation: Augmentation,
    lookahead: int = DEFAULT_LOOKAHEAD,
    *,
    nearby: bool = False,
) -> Batch:
    """Batch of voxels (V, 4) of octrees `tree` (V,) with their stored views (V, R, 12), drawn `lookahead` levels
    ahead; `nearby`: with the luminances that a mixture needs."""
    stored = np.ascontiguousarray(tree, np.int32), np.ascontiguousarray(voxel, np.uint16), np.ascontiguousarray(views)
    blocks, rows, rays, near = _gather(
        (forest.nodes, forest.light, forest.normal, forest.root),
        stored,
        (augmentation.remap, augmentation.symmetry, cube_symmetries(lookahead)),
        (lookahead, block_values(lookahead, nearby=nearby), nearby),
        (BLOCK_POSITION, mask_geometry(), nearby_order()),
    )
    return Batch(blocks, rows, *rays, nearby=Nearby(*near) if nearby else None)


@kernel
def _gather(forest, stored, augmentation, how, tables):
    """Gather a batch in one call: Python between several calls would evict code and data from the caches."""
    nodes, light_of, normal, root = forest
    trees, voxels, views = stored
    _, symmetry, symmetries = augmentation
    lookahead, width, nearby = how
    position, geometry, orders = tables
    count = len(trees)
    tree, voxel = trees.astype(np.int64), voxels.astype(np.int32)
    linear = np.empty((count, 2), np.float32)  # gain and offset of luminance
    blocks = np.empty((27 * count + 1, width), np.float32)
    moved = np.zeros((count, 27), np.int64)  # rows of `blocks` by position after the symmetry
    around = np.empty((count, 27), np.int32)
    where, cells_of = (root, tree, voxel), (light_of.luminance, normal)
    found, how_blocks = (moved, around, linear), (lookahead, not nearby)
    used = _gather_blocks(nodes, cells_of, where, augmentation, how_blocks, blocks, found)
    entry, direction, up, ratio, coverage, light = _read_views(views)
    near_views = views.shape[1] if nearby else 0
    near = (
        np.empty((count, near_views, VIEW), np.float32),
        np.empty((count, near_views, COVERING), np.float32),
        np.empty((count, near_views, MIXED), np.float32),
    )
    if nearby:
        rays = entry, direction, up, ratio
        gather_nearby(nodes, light_of, (tree, around, linear), rays, (geometry, orders), near)
    _turn_views((entry, direction, up), light, (symmetry, symmetries), linear)
    return blocks[:used], _corner_rows(moved, position), (entry, direction, up, ratio, coverage, light), near


@device
def _gather_blocks(nodes, cells_of, voxels, augmentation, how, blocks, found):
    """Write each occupied block as a row of `blocks` after an empty one; returns the number of rows.

    found: per voxel the rows of its blocks, `around` in the order of bricks, gain and offset of its luminance.
    """
    luminance, normal = cells_of
    root, tree, voxel = voxels
    remap, symmetry, symmetries = augmentation
    lookahead, with_luminance = how
    moved, around, linear = found
    empty = empty_brick(lookahead)
    blocks[0] = 0
    row = 1
    for v in range(len(tree)):
        nodes_around(nodes, root[tree[v]], voxel[v, 0], voxel[v, 1:], around[v])
        own, brick = tree_nodes(nodes, tree[v]), Brick(empty.nodes, empty.counts, around[v])
        fill_blocks(own, lookahead, brick)
        _remap(luminance, brick, remap[v], linear[v])
        light = np.float32(linear[v, 0] / np.float32(LUMINANCE_SCALE)), linear[v, 1], with_luminance
        turn = symmetry[v]
        turned = symmetries.axis[turn], symmetries.sign[turn], symmetries.cell[turn]
        for block in range(27):
            if brick.counts[block] > 0:
                moved[v, symmetries.block[turn, block]] = row
                _write_block(own, (luminance, normal), brick.nodes[block], light, turned, blocks[row])
                row += 1
    return row


@lean_device
def _remap(luminance, brick, remap, linear):
    """Write gain and offset of a voxel's luminances into `linear` (2,); remap: as in `Augmentation`."""
    linear[0], linear[1] = 1.0, 0.0
    if remap[3] == 0:
        return
    low, high = LUMINANCE_SCALE, 0.0
    for block in range(27):
        for cell in range(brick.nodes.shape[1] if brick.counts[block] > 0 else 0):
            node = brick.nodes[block, cell]
            if node >= 0:
                light = luminance[node]
                low, high = min(low, light), max(high, light)
    dark, bright = low / LUMINANCE_SCALE, high / LUMINANCE_SCALE
    gain = min(remap[0], 1.0 / max(bright - dark, 1e-6))
    place = remap[1] * (1.0 - gain * (bright - dark))  # the darkest cell's new luminance
    if remap[2] > 0:  # inverted: the brightest cell becomes the darkest
        linear[0], linear[1] = -gain, place + gain * bright
    else:
        linear[0], linear[1] = gain, place - gain * dark


@lean_device
def _write_block(own, cells_of, nodes, light, turned, values):
    """Write the cells of a block, whose nodes are (8^n,), into `values` (B,)."""
    luminance, normal = cells_of
    gain, offset, with_luminance = light
    axis, sign, to_cell = turned
    first_boxed, boxes = own.first_boxed, own.boxes
    ax, ay, az = axis[0], axis[1], axis[2]
    scale = np.float32(1.0 / NORMAL_SCALE)
    channels = CHANNELS if with_luminance else CHANNELS - 1
    sx, sy, sz = sign[0] * scale, sign[1] * scale, sign[2] * scale
    for k in range(len(values)):
        values[k] = 0
    for cell in range(len(nodes)):
        node = nodes[cell]
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
def _corner_rows(moved, position):
    """Rows (8 V, 8) of the blocks of each corner's patch, see `Batch`."""
    rows = np.empty((8 * len(moved), 8), np.int64)
    for v in range(len(moved)):
        for corner in range(8):
            for octant in range(8):
                rows[8 * v + corner, octant] = moved[v, position[corner, octant]]
    return rows


@device
def _read_views(views):
    """Entry, direction, up (V, R, 3), ratio, coverage, luminance (V, R), float32, of stored views (V, R, 12)."""
    voxels, count = views.shape[:2]
    entry, direction = np.empty((voxels, count, 3), np.float32), np.empty((voxels, count, 3), np.float32)
    up, ratio = np.empty((voxels, count, 3), np.float32), np.empty((voxels, count), np.float32)
    coverage, luminance = np.empty((voxels, count), np.float32), np.empty((voxels, count), np.float32)
    unit, signed = np.float32(UNIT), np.float32(SIGNED)
    for v in range(voxels):
        for r in range(count):
            for axis in range(3):
                entry[v, r, axis] = np.float32(views[v, r, axis]) / unit
                direction[v, r, axis] = np.float32(np.int16(views[v, r, 3 + axis])) / signed
                up[v, r, axis] = np.float32(np.int16(views[v, r, 6 + axis])) / signed
            ratio[v, r] = np.float32(views[v, r, 9]) / unit
            coverage[v, r] = np.float32(views[v, r, 10]) / np.float32(COVERAGE_SCALE)
            luminance[v, r] = np.float32(views[v, r, 11]) / unit
    return entry, direction, up, ratio, coverage, luminance


@device
def _turn_views(vectors, luminance, turned, linear):
    """Rotate entry, direction and up (V, R, 3) of views by the symmetry of their voxel, and map luminance (V, R).

    turned: numbers (V,) of symmetries, and their tables. linear: (V, 2) gain and offset of luminance.
    """
    entry, direction, up = vectors
    symmetry, symmetries = turned
    before, half = np.empty((3, 3), np.float32), np.float32(0.5)
    for v in range(entry.shape[0]):
        axis, sign = symmetries.axis[symmetry[v]], symmetries.sign[symmetry[v]]
        for r in range(entry.shape[1]):
            before[0], before[1], before[2] = entry[v, r], direction[v, r], up[v, r]
            for k in range(3):
                source, s = axis[k], sign[k]
                entry[v, r, k] = s * (before[0, source] - half) + half
                direction[v, r, k] = s * before[1, source]
                up[v, r, k] = s * before[2, source]
            luminance[v, r] = luminance[v, r] * linear[v, 0] + linear[v, 1]
