# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the luminance mixture's decoder, gathered from octree and codes (methods 11.2)."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ..network.kinds import CORNERS
from ..octree.nodes import BoxedNodes
from ..octree.sides import NodeLight
from ..runtime.kernels import lean_device
from .coded_octree import CodedOctree
from .corner_rows import corner_row
from .fine_cells import list_fine, place_fine
from .footprint import set_frame
from .outer_cells import list_cells, mask_geometry, measure_cells, unpack_cells
from .patches import OCTANTS
from .ray_frame import SIDE, cell_order, ray_frame

# Cell (8, 8) of a 4x4x4 block by octant and octant within it, or by corner and cell around the corner.
_CELL_OF = (2 * OCTANTS[:, None] + OCTANTS) @ np.array([1, SIDE, SIDE**2])


class NearbyCells(NamedTuple):
    """Cells of a mixture, and their index.

    cells: (8 C,) uint32, the eight words around each corner. rows: of corners, see `corner_rows.py`. geometry: of child
    masks, see `mask_geometry`. order: of cells in each ray frame, see `nearby_order`.
    """

    nodes: BoxedNodes
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
        return cls(octree.boxed_nodes, octree.light, cells, coded.corner_rows, mask_geometry(), nearby_order())


@cache
def nearby_order() -> np.ndarray:
    """Number (48, 64) uint8 in each ray frame of the 4x4x4 cells, which are indexed by 8 octant + octant within it.

    This is the order of grandchildren in an octree, and of cells around the corners of a voxel.
    """
    return np.ascontiguousarray(cell_order()[:, _CELL_OF.ravel()], np.uint8)


@lean_device
def place_pixel(nearby, voxel, ray, work, view, covered, shown, place):  # type: ignore[no-untyped-def]
    """Write a pixel's view of a voxel and its surroundings into column `place` of a tile, except its children.

    voxel: its node, and the row of its corners. ray: entry, direction, up (3,) and ratio. work: a `FootprintTile`,
    input of `measure_tile`, a `FineList` and an `OuterList`. view: see `set_frame`. covered, shown: see `measure_tile`.
    """
    node, row = voxel
    tile, fine, listed = work
    frame, axes = set_ray(ray, tile, view, place)
    order = nearby.order, frame
    count = list_fine(nearby.nodes, nearby.light, node, ray[1], fine)
    place_fine(fine, count, (nearby.order, frame, axes), tile, place)
    cells, rows, geometry = nearby.cells, nearby.rows, nearby.geometry  # once: each access changes a reference count
    count = 0
    for corner in range(CORNERS):
        count = list_cells(cells, CORNERS * corner_row(rows, row, corner), corner, geometry, listed, count)
    unpack_cells(listed, count)
    measure_cells(listed, count, ray, covered, shown, order, place)


@lean_device
def set_ray(ray, tile, view, place):  # type: ignore[no-untyped-def]
    """Write a ray into column `place` of a tile; returns the number of its frame, and the three axes of that."""
    entry, direction, up, ratio = ray
    number, first, second, third = ray_frame(direction[0], direction[1], direction[2])
    set_frame(tile.frame, (first, second, third), entry, direction, up, ratio, view, place)
    return number, (first, second, third)
