# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the luminance mixture's decoder, gathered from octree and codes (methods 11.2)."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ..cells.leaf_box_kernels import covered_steps
from ..cells.leaf_boxes import STEPS
from ..cells.scales import LUMINANCE_SCALE
from ..directional.node_kernels import luminance_along
from ..directional.node_light import NodeLight
from ..network.kinds import CHILDREN, CORNERS
from ..octree.octree import Nodes
from ..runtime.kernels import array_device, device
from ..runtime.vectors import LANES, lowest_one
from .brick import OCTANTS
from .coded_octree import CodedOctree
from .corner_row_kernels import corner_row
from .footprint import FootprintTile, empty_footprint_tile, fine_place, set_frame
from .outer_cells import OuterList, empty_outer_list, list_cells, mask_geometry, measure_cells, unpack_cells
from .ray_frame import CELLS, SIDE, cell_order, ray_frame

# Cell (8, 8) of a 4x4x4 block by octant and octant within it, or by corner and cell around the corner.
_CELL_OF = (2 * OCTANTS[:, None] + OCTANTS) @ np.array([1, SIDE, SIDE**2])


class FineList(NamedTuple):
    """List of a voxel's existing grandchildren, (64,) each; a leaf represents all of its children.

    number: int64, 8 octant of the child + octant in that. light: float32 luminances. shares: (3 * 64,) float32, covered
    part of their faces across each octree axis.
    """

    number: np.ndarray
    light: np.ndarray
    shares: np.ndarray


@array_device
def empty_fine_list():
    """Allocate a list of a voxel's grandchildren."""
    numbers, lights = np.zeros(CELLS, np.int64), np.zeros(CELLS, np.float32)
    return FineList(numbers, lights, np.zeros(3 * CELLS, np.float32))


@device
def list_fine(nodes, light, node, direction, listed):
    """List the grandchildren of a node of `Nodes`, with luminances along a direction; returns their number."""
    numbers, lights = listed.number, listed.light
    scale = np.float32(1.0 / LUMINANCE_SCALE)
    mask, child = np.int64(nodes.child_mask[node]), np.int64(nodes.first_child[node])
    first_boxed, count = nodes.first_boxed, 0
    listed.shares[:] = 1
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
                _list_box(nodes.boxes, cell - first_boxed, listed.shares, count)
            cell += step
            count += 1
        child += 1
    return count


@device
def _list_box(boxes, row, shares, index):
    """Write the shares of the faces of the cell at an index of the list that its box covers."""
    covered, scale = covered_steps(boxes, row), np.float32(1 / STEPS**2)
    for axis in range(3):
        shares[axis * CELLS + index] = np.float32(covered[axis]) * scale


@device
def place_fine(listed, count, order, axes, tile, place):
    """Write the first `count` cells of a list into column `place` of a cleared `FootprintTile`.

    order: (64,) of `nearby_order` in the ray's frame. axes: of that frame.
    """
    numbers, lights, listed_shares, fine, shares = listed.number, listed.light, listed.shares, tile.fine, tile.shares
    first, lane = fine_place(place)
    x, y, z = axes[0] * CELLS, axes[1] * CELLS, axes[2] * CELLS
    for index in range(count):
        row = first + np.int64(order[numbers[index]]) * LANES
        fine[row + lane] = lights[index]
        at = 3 * row + lane
        shares[at] = listed_shares[x + index]
        shares[at + LANES] = listed_shares[y + index]
        shares[at + 2 * LANES] = listed_shares[z + index]


class CellWork(NamedTuple):
    """Scratch for cells near pixels: a tile for `measure_tile`, and lists of one voxel's cells."""

    tile: FootprintTile
    fine: FineList
    outer: OuterList


@array_device
def empty_cell_work():
    """Allocate scratch; call `clear_tile` before use."""
    return CellWork(empty_footprint_tile(), empty_fine_list(), empty_outer_list())


class NearbyCells(NamedTuple):
    """Cells of a mixture, and their index.

    cells: (8 C,) uint32, the eight words around each corner. rows: of corners, see `corner_rows.py`. geometry: of child
    masks, see `mask_geometry`. order: of cells in each ray frame, see `nearby_order`.
    """

    nodes: Nodes
    light: NodeLight
    cells: np.ndarray
    rows: np.ndarray
    geometry: np.ndarray
    order: np.ndarray

    @classmethod
    def of(cls, coded: CodedOctree) -> NearbyCells:
        """Cells of an octree with codes of a mixture."""
        assert coded.corner_cells is not None
        octree = coded.octree
        cells = np.ascontiguousarray(coded.corner_cells).ravel()
        return cls(octree.nodes, octree.light, cells, coded.corner_rows, mask_geometry(), nearby_order())


@cache
def nearby_order() -> np.ndarray:
    """Number (48, 64) uint8 in each ray frame of the 4x4x4 cells, which are indexed by 8 octant + octant within it.

    This is the order of grandchildren in an octree, and of cells around the corners of a voxel.
    """
    return np.ascontiguousarray(cell_order()[:, _CELL_OF.ravel()], np.uint8)


@device
def place_pixel(nearby, voxel, ray, work, view, covered, shown, place):
    """Write a pixel's view of a voxel and its surroundings into column `place` of a tile, except its children.

    voxel: its node, and the row of its corners. ray: `PixelRay`. work: `CellWork`. view: see `set_frame`. covered,
    shown: see `measure_tile`.
    """
    node, row = voxel
    tile, fine, listed = work
    frame, axes = set_ray(ray, tile, view, place)
    order = nearby.order[frame]
    count = list_fine(nearby.nodes, nearby.light, node, ray.direction, fine)
    place_fine(fine, count, order, axes, tile, place)
    cells, rows, geometry = nearby.cells, nearby.rows, nearby.geometry  # once: each access changes a reference count
    count = 0
    for corner in range(CORNERS):
        count = list_cells(cells, CORNERS * corner_row(rows, row, corner), corner, geometry, listed, count)
    unpack_cells(listed, count)
    measure_cells(listed, count, ray, order, covered, shown, place)


@device
def set_ray(ray, tile, view, place):
    """Write a ray into column `place` of a tile; returns the number of its frame, and the three axes of that."""
    direction = ray.direction
    number, axes = ray_frame(direction[0], direction[1], direction[2])
    set_frame(tile.frame, axes, ray, view, place)
    return number, axes
