# SPDX-License-Identifier: GPL-3.0-or-later
"""Training batches: the occupied blocks around V voxels, and R views of each, optionally augmented.

A corner's patch is eight blocks, shared by the corners of a voxel: a batch stores each block once, with the eight
indices of each corner's patch. The kernels are serial, since several threads gather batches at the same time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...patchnet_addon.cells.leaf_box_kernels import filled_share
from ...patchnet_addon.cells.scales import LUMINANCE_SCALE, NORMAL_SCALE
from ...patchnet_addon.codes.brick import MIDDLE, Brick, empty_brick, fill_blocks, nodes_around
from ...patchnet_addon.codes.footprint import PixelRay
from ...patchnet_addon.codes.mixture_inputs import nearby_order
from ...patchnet_addon.codes.outer_cells import mask_geometry
from ...patchnet_addon.network.kinds import COVERING, MIXED, VIEW
from ...patchnet_addon.network.weights import CHANNELS
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.kernels import array_device, device, kernel
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
    entry, direction, up: (V, R, 3) float32. ratio, coverage, luminance: (V, R) float32. own: (V,) float32, luminance of
    the voxels themselves, without augmentation.
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
    own: Any
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
    unit, symmetries = np.float32(UNIT), cube_symmetries(lookahead)
    entry, ratio, luminance = views[..., :3] / unit, views[..., 9] / unit, views[..., 11] / unit
    direction, up = (views[..., at : at + 3].astype(np.int16) / np.float32(SIGNED) for at in (3, 6))
    rays = PixelRay(entry, direction, up, ratio)
    blocks, moved, around, linear, near = _gather(
        (forest.nodes, forest.light, forest.normal, forest.root),
        (np.ascontiguousarray(tree, np.int32), np.ascontiguousarray(voxel, np.uint16), rays),
        (augmentation.remap, augmentation.symmetry, symmetries),
        (lookahead, block_values(lookahead, nearby=nearby), nearby),
        (mask_geometry(), nearby_order()),
    )
    axis, sign = (table[augmentation.symmetry][:, None] for table in (symmetries.axis, symmetries.sign))  # (V, 1, 3)
    half = np.float32(0.5)
    centred, direction, up = (sign * np.take_along_axis(each, axis, axis=2) for each in (entry - half, direction, up))
    return Batch(
        blocks,
        moved[:, BLOCK_POSITION].reshape(-1, 8),
        centred + half,
        direction,
        up,
        ratio,
        views[..., 10] / np.float32(COVERAGE_SCALE),
        luminance * linear[:, :1] + linear[:, 1:],
        forest.luminance[around[:, MIDDLE]] / np.float32(LUMINANCE_SCALE),
        nearby=near if nearby else None,
    )


@kernel
def _gather(forest, stored, augmentation, how, tables):
    """Blocks of a batch; of each voxel the rows of its blocks, their nodes, and its linear map; cells near its rays.

    It is one call: Python between several calls would evict code and data from the caches.
    """
    nodes, light_of, normal, root = forest
    trees, voxels, rays = stored
    lookahead, width, nearby = how
    geometry, orders = tables
    count = len(trees)
    tree, voxel = trees.astype(np.int64), voxels.astype(np.int32)
    linear = np.empty((count, 2), np.float32)  # gain and offset of luminance
    blocks = np.empty((27 * count + 1, width), np.float32)
    moved = np.zeros((count, 27), np.int64)  # rows of `blocks` by position after the symmetry
    around = np.empty((count, 27), np.int32)
    where, cells_of = (root, tree, voxel), (light_of.luminance, normal)
    found, how_blocks = (moved, around, linear), (lookahead, not nearby)
    used = _gather_blocks(nodes, cells_of, where, augmentation, how_blocks, blocks, found)
    near_views = rays.ratio.shape[1] if nearby else 0
    near = Nearby(
        np.empty((count, near_views, VIEW), np.float32),
        np.empty((count, near_views, COVERING), np.float32),
        np.empty((count, near_views, MIXED), np.float32),
    )
    if nearby:
        gather_nearby(nodes, light_of, (tree, around, linear), rays, (geometry, orders), near)
    return blocks[:used], moved, around, linear, near


@array_device
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


@device
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


@device
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
