# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of the luminance mixture's decoder, gathered from octree and codes (methods 11.2)."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..network.kinds import CODE_SIZE, CORNERS, SIDE_BY_SIDE
from ..network.mixture_decode import MixtureInputs
from ..octree.leaf_boxes import covered_shares
from ..octree.nodes import BoxedNodes
from ..octree.octree import Octree
from ..runtime.kernels import lean_device
from .coded_octree import CodedOctree
from .corner_rows import corner_row
from .fine_cells import list_fine, place_fine
from .footprint import ABSENT, footprint_reference, set_frame
from .outer_cells import (
    OUTER_CELLS,
    list_cells,
    mask_geometry,
    measure_cells,
    outer_cells_reference,
    unpack_cells,
)
from .patches import OCTANTS
from .ray_frame import CELLS, SIDE, cell_order, ray_frame, ray_frames

if TYPE_CHECKING:
    from ..tracing.render import Hits

# Cell (8, 8) of a 4x4x4 block by octant of the whole and octant in that, or by corner and cell around the corner.
_CELL_OF = (2 * OCTANTS[:, None] + OCTANTS) @ np.array([1, SIDE, SIDE**2])


class NearbyCells(NamedTuple):
    """Cells that are mixed, and what finds them.

    cells: (8 C,) uint32, the eight words around each corner. rows: of corners, see `corner_rows.py`. geometry: of child
    masks, see `mask_geometry`. order: of cells in each ray frame, see `nearby_order`.
    """

    nodes: BoxedNodes
    luminance: np.ndarray
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
        return cls(octree.boxed_nodes, octree.luminance, cells, coded.corner_rows, mask_geometry(), nearby_order())


@cache
def nearby_order() -> np.ndarray:
    """Number (48, 64) uint8 in each ray frame of the 4x4x4 cells by octant: 8 octant of the whole + octant in that.

    That is as children and their children stand in an octree, and cells around the corners of a voxel.
    """
    return np.ascontiguousarray(cell_order()[:, _CELL_OF.ravel()], np.uint8)


@lean_device
def place_pixel(nearby, voxel, ray, work, view, covered, shown, place):  # type: ignore[no-untyped-def]
    """Write what a pixel shows of a voxel and around it into column `place` of a tile, but for its children.

    voxel: its node, and the row of its corners. ray: entry, direction, up (3,) and ratio. work: a `FootprintTile`,
    whose columns `measure_tile` needs, a `FineList` and an `OuterList`. view: see `set_frame`. covered, shown: see
    `measure_tile`.
    """
    node, row = voxel
    tile, fine, listed = work
    frame, axes = set_ray(ray, tile, view, place)
    order = nearby.order, frame
    count = list_fine(nearby.nodes, nearby.luminance, node, fine)
    place_fine(fine, count, (nearby.order, frame, axes), tile, place)
    cells, rows, geometry = nearby.cells, nearby.rows, nearby.geometry  # once: each access counts holders
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


def mixture_inputs_reference(coded: CodedOctree, pixels: np.ndarray, hits: Hits) -> MixtureInputs:
    """Inputs for some pixels (M,) of hits with look-ahead, in NumPy."""
    octree, node = coded.octree, hits.node[pixels]
    corners = coded.corners_of(coded.rows_of(node))  # (M, 8)
    assert coded.corner_cells is not None
    corner_codes = coded.codes[corners].astype(np.float32)
    entry, direction, up = (array[pixels].astype(np.float32) for array in (hits.entry_voxel, hits.direction, hits.up))
    ratio = hits.ratio[pixels].astype(np.float32)
    shares = np.where(OCTANTS == 1, entry[:, None], 1 - entry[:, None]).prod(axis=-1)  # (M, 8)
    frames, axes, _ = ray_frames(direction)
    order = cell_order()[frames]  # (M, 64)
    fine, faces = _grandchildren(octree, node)
    seen_fine, seen_faces = np.empty_like(fine), np.empty_like(faces)
    np.put_along_axis(seen_fine, order, fine, 1)
    np.put_along_axis(seen_faces, order[:, None], np.take_along_axis(faces, axes[..., None], 1), 2)
    view, covered, light = footprint_reference(seen_fine, entry, direction, up, ratio, seen_faces)
    cells = coded.corner_cells[corners].reshape(-1, CELLS)
    around = outer_cells_reference(cells, entry, direction, up, ratio)
    outer_covered, outer_light = (_in_ray_order(values, order)[:, OUTER_CELLS] for values in around)
    return MixtureInputs(
        codes=np.einsum("mo,moc->mc", shares, corner_codes).reshape(-1, CODE_SIZE),
        corner_codes=corner_codes[:, :, :SIDE_BY_SIDE],
        direction=direction,
        up=up,
        ratio=ratio,
        view=view,
        covered=np.concatenate([covered, outer_covered], axis=1),
        luminances=np.concatenate([light, outer_light, octree.luminance_float(node)[:, None]], axis=1),
    )


def _in_ray_order(values: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Values (M, 64) by 8 corner + octant as values of the cells of each ray's frame; order: (M, 64), `cell_order`."""
    found = np.empty_like(values)
    np.put_along_axis(found, order[:, _CELL_OF.ravel()], values, 1)
    return found


def _grandchildren(octree: Octree, node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Luminances (M, 64) of the children's children of nodes (M,), -1 for none, and what they cover of their cells'
    faces across each axis (M, 3, 64); x + 4 y + 16 z. A leaf is all of its children.
    """
    child = _children(octree, node)
    inner = np.where((octree.child_mask[child] == 0)[..., None], child[..., None], _children(octree, child))
    inner = np.where((child >= 0)[..., None], inner, -1)
    fine = np.empty((len(node), CELLS), np.float32)
    fine[:, _CELL_OF] = np.where(inner >= 0, octree.luminance_float(np.maximum(inner, 0)), ABSENT)
    whole = np.ones((*inner.shape, 3), np.float32)
    if octree.leaf_box is not None:
        first = int(octree.level_start[octree.depth])
        whole[inner >= first] = covered_shares(octree.leaf_box[inner[inner >= first] - first])
    shares = np.empty((len(node), 3, CELLS), np.float32)
    shares[:, :, _CELL_OF] = np.moveaxis(whole, -1, 1)
    return fine, shares


def _children(octree: Octree, node: np.ndarray) -> np.ndarray:
    """Children (..., 8) int64 of nodes (...,), -1 for none."""
    mask = octree.child_mask[node].astype(np.int64)[..., None] >> np.arange(8) & 1
    return np.where(mask == 1, octree.first_child[node].astype(np.int64)[..., None] + np.cumsum(mask, -1) - 1, -1)
