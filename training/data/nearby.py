# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells in and around training voxels, as the views of a luminance mixture see them (methods 11.2).

They are given in the frame of each ray, which is the same however voxel and ray are turned: no augmentation changes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.codes.brick import MIDDLE
from ...patchnet_addon.codes.corner_cells import empty_work, write_cells_around
from ...patchnet_addon.codes.fine_cells import empty_fine_list, list_fine, place_fine
from ...patchnet_addon.codes.footprint import clear_tile, empty_footprint_tile, measure_tile
from ...patchnet_addon.codes.mixture_inputs import nearby_order, set_ray
from ...patchnet_addon.codes.outer_cells import empty_outer_list, list_cells, mask_geometry, measure_cells, unpack_cells
from ...patchnet_addon.codes.pixel_tiles import PixelRays
from ...patchnet_addon.codes.ray_frame import CELLS
from ...patchnet_addon.network.compiled_layers import TILE, empty_values
from ...patchnet_addon.network.kinds import CORNERS, COVERING, MIXED, VIEW
from ...patchnet_addon.octree.octree import LUMINANCE_SCALE
from ...patchnet_addon.runtime.kernels import kernel, lean_device
from .fetch_ahead import AHEAD, fetch_cells, fetch_children
from .forest import Forest, tree_nodes


@dataclass(frozen=True, eq=False)
class Nearby:
    """Cells near V voxels in R views each, float32, see `MixtureInputs`.

    view: (V, R, 9). covered: (V, R, 64). luminances: (V, R, 65).
    """

    view: np.ndarray
    covered: np.ndarray
    luminances: np.ndarray


def gather_nearby(
    forest: Forest, tree: np.ndarray, around: np.ndarray, rays: tuple[np.ndarray, ...], linear: np.ndarray
) -> Nearby:
    """Cells near V voxels of octrees `tree` (V,), as R rays see them, none of them turned.

    around: (V, 27) int32, see `Brick`. rays: entry, direction, up (V, R, 3) and ratio (V, R). linear: (V, 2) gain and
    offset of luminance.
    """
    voxels, views = rays[3].shape
    count = voxels * views
    entry, direction, up = (np.ascontiguousarray(array, np.float32).reshape(-1, 3) for array in rays[:3])
    flat = PixelRays(np.repeat(np.arange(voxels), views), entry, direction, up, np.float32(rays[3]).ravel())
    view, covered = np.empty((count, VIEW), np.float32), np.empty((count, COVERING), np.float32)
    luminances = np.empty((count, MIXED), np.float32)
    tables = mask_geometry(), nearby_order()
    where = tree.astype(np.int64), around, linear
    _gather(forest.nodes, forest.luminance, where, flat, tables, (view, covered, luminances))
    return Nearby(*(array.reshape(voxels, views, -1) for array in (view, covered, luminances)))


@kernel
def _gather(nodes, luminance, where, rays, tables, found):
    tile, views, listed, fine = empty_footprint_tile(), empty_values(VIEW), empty_outer_list(), empty_fine_list()
    shares, lights = empty_values(COVERING), empty_values(COVERING)
    words, work = np.empty(CELLS, np.uint32), empty_work()
    tree, around, linear = where
    view, covered, luminances = found
    geometry, orders = tables
    number, entry, direction, up, ratio = rays.node, rays.entry, rays.direction, rays.up, rays.ratio
    last, node = np.int64(-1), np.int64(-1)  # the voxel, and its node
    inside, near = 0, 0  # cells that are listed in and around it
    own = tree_nodes(nodes, 0)
    for start in range(0, len(ratio), TILE):
        count = min(TILE, len(ratio) - start)
        clear_tile(tile, shares, lights)
        for place in range(count):
            index = start + place
            here = number[index]
            if here != last:
                if here + 2 * AHEAD < len(around):
                    fetch_children(nodes, around[here + 2 * AHEAD])
                if here + AHEAD < len(around):
                    fetch_cells(nodes, luminance, 1, around[here + AHEAD])
                own, node = tree_nodes(nodes, tree[here]), np.int64(around[here, MIDDLE])
                write_cells_around(own, luminance, around[here], words, work)
                inside, near = list_fine(own, luminance, node, fine), 0
                for corner in range(CORNERS):
                    near = list_cells(words, CORNERS * corner, corner, geometry, listed, near)
                unpack_cells(listed, near)
                last = here
            ray = entry[index], direction[index], up[index], ratio[index]
            frame, axes = set_ray(ray, tile, views, place)
            place_fine(fine, inside, (orders, frame, axes), tile, place)
            measure_cells(listed, near, ray, shares, lights, (orders, frame), place)
            luminances[index, COVERING] = np.float32(luminance[node]) * np.float32(1.0 / LUMINANCE_SCALE)
        measure_tile(tile, shares, lights)
        _write_columns(views, count, view[start:])
        _write_columns(shares, count, covered[start:])
        _write_columns(lights, count, luminances[start:])
        for index in range(start, start + count):
            gain, offset = linear[number[index], 0], linear[number[index], 1]
            for k in range(MIXED):
                luminances[index, k] = gain * luminances[index, k] + offset


@lean_device
def _write_columns(rows, count, result):  # type: ignore[no-untyped-def]
    """Write the first `count` columns of a tile's rows as lines of `result`."""
    for place in range(count):
        for row in range(len(rows) // TILE):
            result[place, row] = rows[row * TILE + place]
