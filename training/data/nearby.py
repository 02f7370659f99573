# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells in and around training voxels, as input of a luminance mixture (methods 11.2).

They are in the frame of each ray, which is invariant to rotations of voxel and ray, and thus to augmentation.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...patchnet_addon.cells.scales import LUMINANCE_SCALE
from ...patchnet_addon.codes.brick import MIDDLE, child_at
from ...patchnet_addon.codes.corner_cells import EMPTY, word_of
from ...patchnet_addon.codes.footprint import PixelRay, clear_tile, measure_tile
from ...patchnet_addon.codes.mixture_inputs import empty_cell_work, list_fine, place_fine, set_ray
from ...patchnet_addon.codes.outer_cells import list_cells, measure_cells, unpack_cells
from ...patchnet_addon.codes.ray_frame import CELLS, SIDE
from ...patchnet_addon.network.compiled_layers import TILE, empty_values
from ...patchnet_addon.network.kinds import CORNERS, COVERING, MIXED, VIEW
from ...patchnet_addon.runtime.kernels import array_device, device
from .forest import tree_nodes


class Nearby(NamedTuple):
    """Cells near V voxels in R views each, float32 arrays or tensors, see `MixtureInputs`.

    view: (V, R, 9). covered: (V, R, 64). luminances: (V, R, 65).
    """

    view: Any
    covered: Any
    luminances: Any


@array_device
def gather_nearby(nodes, light, where, rays, tables, found):
    """Write cells near V voxels in the frames of R rays, without augmentation, into `found`, a `Nearby`.

    nodes, light: of a `Forest`. where: octrees (V,) int64, around (V, 27) int32, see `Brick`, and gain and offset (V,
    2) of luminance. rays: `PixelRay` of arrays (V, R, 3), ratio (V, R). tables: `mask_geometry`, `nearby_order`.
    """
    count, of_voxel = rays.ratio.size, rays.ratio.shape[1]
    entry, direction = rays.entry.reshape((count, 3)), rays.direction.reshape((count, 3))
    up, ratio = rays.up.reshape((count, 3)), rays.ratio.reshape(count)
    view, covered, luminances = found
    view, covered = view.reshape((count, VIEW)), covered.reshape((count, COVERING))
    luminances = luminances.reshape((count, MIXED))
    tile, fine, listed = empty_cell_work()
    views, shares, lights = empty_values(VIEW), empty_values(COVERING), empty_values(COVERING)
    words = np.empty(CELLS, np.uint32)
    tree, around, linear = where
    geometry, orders = tables
    last, node = np.int64(-1), np.int64(-1)  # the voxel, and its node
    inside, near = 0, 0  # cells that are listed in and around it
    own = tree_nodes(nodes, 0)
    for start in range(0, len(ratio), TILE):
        together = min(TILE, len(ratio) - start)
        clear_tile(tile, shares, lights)
        for place in range(together):
            index = start + place
            here = index // of_voxel
            if here != last:
                own, node = tree_nodes(nodes, tree[here]), np.int64(around[here, MIDDLE])
                _write_words(own, light, around[here], words)
                inside, near = list_fine(own, light, node, direction[index], fine), 0
                for corner in range(CORNERS):
                    near = list_cells(words, CORNERS * corner, corner, geometry, listed, near)
                unpack_cells(listed, near)
                last = here
            ray = PixelRay(entry[index], direction[index], up[index], ratio[index])
            frame, axes = set_ray(ray, tile, views, place)
            place_fine(fine, inside, orders[frame], axes, tile, place)
            measure_cells(listed, near, ray, orders[frame], shares, lights, place)
            luminances[index, COVERING] = np.float32(light.luminance[node]) * np.float32(1.0 / LUMINANCE_SCALE)
        measure_tile(tile, shares, lights)
        _write_columns(views, together, view[start:])
        _write_columns(shares, together, covered[start:])
        _write_columns(lights, together, luminances[start:])
        for index in range(start, start + together):
            gain, offset = linear[index // of_voxel, 0], linear[index // of_voxel, 1]
            for k in range(MIXED):
                luminances[index, k] = gain * luminances[index, k] + offset


@device
def _write_words(nodes, light, around, words):
    """Write the words (64,) of the cells around the corners of a voxel of an octree; around: see `Brick`.

    Cells in the voxel itself count as empty: pixels read them from the octree.
    """
    words[:] = EMPTY
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
                    corner, inner = (i >> 1) | (j >> 1) << 1 | (k >> 1) << 2, (i & 1) | (j & 1) << 1 | (k & 1) << 2
                    words[CORNERS * corner + inner] = word_of(nodes, light, cell)


@device
def _write_columns(rows, count, result):
    """Write the first `count` columns of a tile's rows as lines of `result`."""
    for place in range(count):
        for row in range(len(rows) // TILE):
            result[place, row] = rows[row * TILE + place]
