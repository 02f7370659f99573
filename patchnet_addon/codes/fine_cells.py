# SPDX-License-Identifier: GPL-3.0-or-later
"""Fine cells of a pixel: the grandchildren of its voxel, with luminances and boxes, for tiles of pixels.

They are listed first: pixels of one voxel share the list; only its order differs between ray frames.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..network.kinds import CHILDREN
from ..octree.leaf_boxes import STEPS, covered_steps
from ..octree.octree import LUMINANCE_SCALE
from ..octree.side_kernels import luminance_along
from ..runtime.bits import lowest_one
from ..runtime.kernels import device, lean_device
from ..runtime.vectors import LANES
from .footprint import fine_place
from .ray_frame import CELLS


class FineList(NamedTuple):
    """List of a voxel's existing grandchildren, (64,) each; a leaf represents all of its children.

    number: int64, 8 octant of the child + octant in that. light: float32 luminances. shares: (3 * 64,) float32, covered
    part of their faces across each octree axis, valid if boxed (1,) bool: any has a box.
    """

    number: np.ndarray
    light: np.ndarray
    shares: np.ndarray
    boxed: np.ndarray


@device
def empty_fine_list():
    """Allocate a list of a voxel's grandchildren."""
    numbers, lights = np.zeros(CELLS, np.int64), np.zeros(CELLS, np.float32)
    return FineList(numbers, lights, np.zeros(3 * CELLS, np.float32), np.zeros(1, np.bool_))


@lean_device
def list_fine(nodes, light, node, direction, listed):  # type: ignore[no-untyped-def]
    """List the grandchildren of a node of `BoxedNodes`, with luminances along a direction; returns their number."""
    numbers, lights = listed.number, listed.light
    scale = np.float32(1.0 / LUMINANCE_SCALE)
    mask, child = np.int64(nodes.child_mask[node]), np.int64(nodes.first_child[node])
    first_boxed, count = nodes.first_boxed, 0
    listed.boxed[0] = False
    while mask != 0:
        octant = lowest_one(mask)
        mask &= mask - 1
        inner, cell, step = np.int64(nodes.child_mask[child]), np.int64(nodes.first_child[child]), 1
        if inner == 0:
            inner, cell, step = np.int64(255), child, 0
        while inner != 0:
            part = lowest_one(inner)
            inner &= inner - 1
            seen = luminance_along(light, cell, direction[0], direction[1], direction[2])
            numbers[count], lights[count] = CHILDREN * octant + part, seen * scale
            if cell >= first_boxed:
                _list_box(nodes.boxes, cell - first_boxed, listed, count)
            cell += step
            count += 1
        child += 1
    return count


@lean_device
def _list_box(boxes, row, listed, index):  # type: ignore[no-untyped-def]
    """Write the shares of the faces of the cell at an index of the list that its box covers."""
    shares, boxed = listed.shares, listed.boxed
    if not boxed[0]:
        shares[:] = 1
        boxed[0] = True
    covered, scale = covered_steps(boxes, row), np.float32(1 / STEPS**2)
    for axis in range(3):
        shares[axis * CELLS + index] = np.float32(covered[axis]) * scale


@lean_device
def place_fine(listed, count, order, tile, place):  # type: ignore[no-untyped-def]
    """Write the first `count` cells of a list into column `place` of a cleared `FootprintTile`.

    order: `nearby_order`, the number of the ray's frame, and its axes.
    """
    orders, frame, axes = order
    numbers, lights, listed_shares, fine, shares = listed.number, listed.light, listed.shares, tile.fine, tile.shares
    first, lane = fine_place(place)
    if not listed.boxed[0]:
        for index in range(count):
            fine[first + orders[frame, numbers[index]] * LANES + lane] = lights[index]
        return
    if not tile.has_boxes[0]:
        shares[:] = 1
        tile.has_boxes[0] = True
    x, y, z = axes[0] * CELLS, axes[1] * CELLS, axes[2] * CELLS
    for index in range(count):
        row = first + np.int64(orders[frame, numbers[index]]) * LANES
        fine[row + lane] = lights[index]
        at = 3 * row + lane
        shares[at] = listed_shares[x + index]
        shares[at + LANES] = listed_shares[y + index]
        shares[at + 2 * LANES] = listed_shares[z + index]
