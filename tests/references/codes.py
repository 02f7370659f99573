# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain references of patch codes: covered cells, corner codes, prediction."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.codes.brick import OCTANTS, corner_neighbours, voxel_blocks
from patchnet.patchnet_addon.codes.coded_octree import CodedOctree
from patchnet.patchnet_addon.codes.corner_cells import (
    _COLUMNS,
    BASE,
    BASE_STEPS,
    EMPTY,
    FACES,
    SLOPE,
    SLOPE_BITS,
    SLOPE_STEPS,
)
from patchnet.patchnet_addon.codes.corner_rows import HIGH, LOW, MAX_STEP, STEPS
from patchnet.patchnet_addon.codes.footprint import ABSENT
from patchnet.patchnet_addon.codes.mixture_inputs import _CELL_OF
from patchnet.patchnet_addon.codes.outer_cells import _COLUMNS as _FIRST_COLUMN
from patchnet.patchnet_addon.codes.outer_cells import _COUNT_BITS, _LOWER, _UPPER, OUTER_CELLS, SMALL, mask_geometry
from patchnet.patchnet_addon.codes.prediction import Prediction
from patchnet.patchnet_addon.codes.ray_frame import CELLS, SIDE, cell_order
from patchnet.patchnet_addon.network.kinds import CHILDREN, CORNERS, SIDE_BY_SIDE
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from patchnet.patchnet_addon.tracing.hits import Hits
from patchnet.tests.references.lookups import covered_shares, covering_nodes_reference, face_luminances, ray_frames
from patchnet.tests.references.networks import MixtureInputs, decode, decode_mixture, joined_blocks
from patchnet.tests.references.sides import luminance_reference


def corners_of(table: np.ndarray, rows: np.ndarray | slice) -> np.ndarray:
    """Rows in the codes (..., 8) int64 of the corners of coded voxels (...,), x fastest."""
    lines = table[rows].astype(np.int64)
    low, high, steps = (lines[..., column] for column in (LOW, HIGH, STEPS))
    starts = np.stack([low, low + (steps & MAX_STEP), high, high + (steps >> 16)], axis=-1)  # (..., 4)
    return (starts[..., None] + np.arange(2)).reshape(*starts.shape[:-1], 8)


def coded_rows_reference(octree: Octree, lookahead: int) -> np.ndarray:
    """Reference of `coded_rows` for all nodes in order: (n,) int64; the last, a leaf, stands for none."""
    coded = octree.look_ahead(lookahead)
    return np.where(coded, np.cumsum(coded) - 1, -1)


def corner_cells_reference(octree: Octree, level: int, corners: np.ndarray) -> np.ndarray:
    """Reference of `corner_cells` in NumPy."""
    cells = (2 * np.asarray(corners)[:, None] - 1 + OCTANTS).reshape(-1, 3)
    node = covering_nodes_reference(octree, level + 1, cells)
    parts = _parts(octree, node)
    lights = np.where(parts >= 0, octree.luminance_float(np.maximum(parts, 0)), np.float32(ABSENT))  # (N, 8)
    masks = (lights >= 0) @ (1 << np.arange(8))
    words = packed_reference(masks, _of_sides(octree, node, face_luminances_reference(lights)))
    return np.where(node >= 0, words, EMPTY).astype(np.uint32).reshape(-1, CORNERS)


def _of_sides(octree: Octree, node: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Luminances (N, 6) of faces of cells, those of the cells' own sides where they have some."""
    if octree.side_nodes is None or octree.side_light is None or octree.side_share is None:
        return faces
    row = np.minimum(np.searchsorted(octree.side_nodes, node), len(octree.side_nodes) - 1)
    order = [1, 0, 3, 2, 5, 4]  # the one that a ray up the axis meets is first
    own, share = (octree.side_light[row] / np.float32(255))[:, order] ** 2, octree.side_share[row][:, order]
    own = np.where(share > 7, own, octree.luminance_float(np.maximum(node, 0))[:, None])
    return np.where((octree.side_nodes[row] == node)[:, None], own, faces)


def face_luminances_reference(lights: np.ndarray) -> np.ndarray:
    """Luminances (N, 6) float32 of faces of cells whose children have luminances (N, 8), -1 for those that are not."""
    faces = []
    for axis, columns in enumerate(_COLUMNS):
        low, high = lights[:, columns], lights[:, [octant | 1 << axis for octant in columns]]
        for first, second in ((low, high), (high, low)):
            seen = np.where(first >= 0, first, second)
            count = (seen >= 0).sum(axis=1)
            total = np.where(seen >= 0, seen, 0).sum(axis=1, dtype=np.float32)
            faces.append(total / np.maximum(count, 1).astype(np.float32))
    return np.stack(faces, axis=1)


def packed_reference(masks: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Words (N,) int64 of cells of child masks (N,) and luminances of faces (N, 6)."""
    roots = np.sqrt(faces, dtype=np.float32)  # float32, here as in the kernel, lest the two round to other steps
    means = roots.sum(axis=1) / np.float32(FACES)
    words = masks.astype(np.int64) | np.floor(BASE_STEPS * means + np.float32(0.5)).astype(np.int64) << BASE
    for axis in range(3):
        half = np.clip((roots[:, 2 * axis + 1] - roots[:, 2 * axis]) / 2, -0.5, 0.5)
        steps = np.copysign(np.floor(SLOPE_STEPS * np.sqrt(2 * np.abs(half)) + 0.5), half)
        words |= (SLOPE_STEPS + steps.astype(np.int64)) << (SLOPE + SLOPE_BITS * axis)
    return words


def footprint_reference(
    fine: np.ndarray,
    entry: np.ndarray,
    direction: np.ndarray,
    up: np.ndarray,
    ratio: np.ndarray,
    shares: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """View (N, 9), coverage (N, 8) and luminances (N, 8), float32, of a voxel's children, in NumPy.

    fine: (N, 64) luminances in the ray frame, ABSENT for none. entry, direction, up: (N, 3) in octree axes.
    ratio: (N,). shares: (N, 3, 64) of the faces across each axis of the ray frame, 1 without them.
    """
    _, axes, signs = ray_frames(direction)

    def turned(vectors: np.ndarray) -> np.ndarray:
        return signs * np.take_along_axis(vectors, axes, 1)

    right, above = turned(np.cross(direction, up)), turned(up)
    along, point = turned(direction), turned(entry - 0.5) + 0.5
    covered, shown = np.zeros((len(fine), CHILDREN)), np.zeros((len(fine), CHILDREN))
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        wide, high = (0.125 * np.abs(plane[:, others]).sum(axis=1) for plane in (right, above))
        area = along[:, axis] / 16
        for cell in range(CELLS):
            place = np.array([cell // SIDE**k % SIDE for k in range(3)])
            free = np.ones(len(fine))
            if place[axis] % 2:
                ahead = cell - SIDE**axis
                free = np.where(fine[:, ahead] >= 0, 1 - (1 if shares is None else shares[:, axis, ahead]), 1)
            free *= 1 if shares is None else shares[:, axis, cell]
            middle = (place + 0.5) / SIDE
            middle[axis] -= 0.125  # the face that the ray meets
            seen = _box_overlap(middle - point, (right, above), (wide, high), area, ratio)
            seen = np.where(fine[:, cell] >= 0, free * seen, 0)
            child = (place // 2) @ np.array([1, 2, 4])
            covered[:, child] += seen
            shown[:, child] += seen * fine[:, cell]
    light = np.divide(shown, covered, out=np.zeros_like(shown), where=covered > 0)
    view = np.concatenate([along, 2 * point - 1, above], axis=1)
    return view.astype(np.float32), (covered / ratio[:, None] ** 2).astype(np.float32), light.astype(np.float32)


def _box_overlap(
    offset: np.ndarray,
    plane: tuple[np.ndarray, ...],
    halves: tuple[np.ndarray, ...],
    area: np.ndarray,
    ratio: np.ndarray,
) -> np.ndarray:
    """Area (...) of pixels that a box covers, whose middle is at offsets (..., 3) from the entry point.

    plane: right and up (..., 3). halves: (...) each, what its outline extends to the right and up. area: of it.
    """
    scale = np.sqrt(area / (4 * halves[0] * halves[1] + SMALL))
    sides = []
    for axis, half in zip(plane, halves, strict=True):
        centre, reach = (offset * axis).sum(axis=-1), half * scale
        sides.append(np.minimum(centre + reach, ratio / 2) - np.maximum(centre - reach, -ratio / 2))
    return np.asarray(np.maximum(sides[0], 0) * np.maximum(sides[1], 0))


def mixture_inputs_reference(coded: CodedOctree, pixels: np.ndarray, hits: Hits) -> MixtureInputs:
    """Inputs for some pixels (M,) of hits with look-ahead, in NumPy."""
    octree, node = coded.octree, hits.node[pixels]
    rows = coded_rows_reference(octree, coded.weights.lookahead)[node]
    corners = corners_of(coded.corner_rows, rows)  # (M, 8)
    assert coded.corner_cells is not None
    corner_codes = coded.codes[corners].astype(np.float32)
    entry, direction, up = (array[pixels].astype(np.float32) for array in (hits.entry_voxel, hits.direction, hits.up))
    ratio = hits.ratio[pixels].astype(np.float32)
    frames, axes, _ = ray_frames(direction)
    order = cell_order()[frames]  # (M, 64)
    fine, faces = _grandchildren(octree, node, direction)
    seen_fine, seen_faces = np.empty_like(fine), np.empty_like(faces)
    np.put_along_axis(seen_fine, order, fine, 1)
    np.put_along_axis(seen_faces, order[:, None], np.take_along_axis(faces, axes[..., None], 1), 2)
    view, covered, light = footprint_reference(seen_fine, entry, direction, up, ratio, seen_faces)
    cells = coded.corner_cells[corners].reshape(-1, CELLS)
    around = outer_cells_reference(cells, entry, direction, up, ratio)
    outer_covered, outer_light = (_in_ray_order(values, order)[:, OUTER_CELLS] for values in around)
    return MixtureInputs(
        codes=interpolate_codes_reference(coded, rows, entry).astype(np.float32),
        corner_codes=corner_codes[:, :, :SIDE_BY_SIDE],
        direction=direction,
        up=up,
        ratio=ratio,
        view=view,
        covered=np.concatenate([covered, outer_covered], axis=1),
        luminances=np.concatenate([light, outer_light, luminance_reference(octree, node, direction)[:, None]], axis=1),
    )


def _in_ray_order(values: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Values (M, 64) by 8 corner + octant as values of the cells of each ray's frame; order: (M, 64), `cell_order`."""
    found = np.empty_like(values)
    np.put_along_axis(found, order[:, _CELL_OF.ravel()], values, 1)
    return found


def _parts(octree: Octree, node: np.ndarray) -> np.ndarray:
    """Children (..., 8) int64 of nodes (...,), -1 for none; a leaf is all of its children."""
    mask = octree.child_mask[node].astype(np.int64)[..., None] >> np.arange(8) & 1
    child = np.where(mask == 1, octree.first_child[node].astype(np.int64)[..., None] + np.cumsum(mask, -1) - 1, -1)
    parts = np.where((octree.child_mask[node] == 0)[..., None], node[..., None], child)
    return np.where((node >= 0)[..., None], parts, -1)


def _grandchildren(octree: Octree, node: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Luminances (M, 64) along directions (M, 3) of the children's children of nodes (M,), -1 for none, and what they
    cover of their cells' faces across each axis (M, 3, 64); x + 4 y + 16 z. A leaf is all of its children.
    """
    inner = _parts(octree, _parts(octree, node))
    fine = np.empty((len(node), CELLS), np.float32)
    seen = luminance_reference(octree, np.maximum(inner, 0), direction[:, None, None])
    fine[:, _CELL_OF] = np.where(inner >= 0, seen, np.float32(ABSENT))
    whole = np.ones((*inner.shape, 3), np.float32)
    if octree.leaf_box is not None:
        first = int(octree.level_start[octree.depth])
        whole[inner >= first] = covered_shares(octree.leaf_box[inner[inner >= first] - first])
    shares = np.empty((len(node), 3, CELLS), np.float32)
    shares[:, :, _CELL_OF] = np.moveaxis(whole, -1, 1)
    return fine, shares


def outer_cells_reference(
    words: np.ndarray, entry: np.ndarray, direction: np.ndarray, up: np.ndarray, ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coverage and luminance (N, 64) float32 of the cells around the corners, by 8 corner + octant, in NumPy.

    words: (N, 64). entry, direction, up: (N, 3). ratio: (N,). Empty cells and those in the voxel have 0.
    """
    right = np.cross(direction, up)
    numbers = np.arange(CELLS)
    corner, octant = OCTANTS[numbers // CORNERS], OCTANTS[numbers % CORNERS]  # (64, 3)
    geometry = mask_geometry().astype(np.int64)[words.astype(np.int64) & 255][..., None]  # (N, 64, 1)
    axes = np.arange(3)
    lower, upper = geometry >> (_LOWER + axes) & 1, geometry >> (_UPPER + axes) & 1
    columns = geometry >> (_FIRST_COLUMN + _COUNT_BITS * axes) & 7
    middle = corner + 0.5 * octant - 0.25 + (upper - lower) / 8
    halves = (upper + lower) / 8
    others = [np.delete(halves, axis, axis=-1).prod(axis=-1) for axis in range(3)]
    area = 4 * sum(np.abs(direction[:, None, axis]) * others[axis] for axis in range(3))
    plane = right[:, None], up[:, None]
    sides = tuple((halves * np.abs(axis)).sum(axis=-1) for axis in plane)
    overlap = _box_overlap(middle - entry[:, None], plane, sides, area, ratio[:, None])
    seen = np.abs(direction)[:, None] * columns  # (N, 64, 3)
    faces = face_luminances(words).reshape(*words.shape, 3, 2)
    met = np.where(direction[:, None] < 0, faces[..., 1], faces[..., 0])
    outer = (words != 0) & (numbers % CORNERS != CORNERS - 1 - numbers // CORNERS)
    total = np.where(outer, seen.sum(axis=-1), 1)
    covered = np.where(outer, overlap * total / 16 / np.where(outer, area, 1) / ratio[:, None] ** 2, 0)
    shown = np.where(outer, (seen * met).sum(axis=-1) / total, 0)
    return covered.astype(np.float32), shown.astype(np.float32)


def corner_blocks_reference(
    octree: Octree, level: int, corners: np.ndarray, lookahead: int = DEFAULT_LOOKAHEAD
) -> np.ndarray:
    """Patches (C, 2 s, 2 s, 2 s, 5) float32 of corners (C, 3) of a level, order z, y, x, channel (methods 7.9)."""
    neighbours = corner_neighbours(octree, level, corners)
    return joined_blocks(voxel_blocks(octree, neighbours.reshape(-1), lookahead), 1 << lookahead)


def predict_reference(coded: CodedOctree, hits: Hits) -> Prediction:
    """Reference of `predict` in NumPy."""
    rows = coded_rows_reference(coded.octree, coded.weights.lookahead)[hits.node]
    pixels = np.flatnonzero(rows >= 0)
    coverage = np.ones(len(rows), np.float32)
    luminance = hits.luminance.astype(np.float32)
    if coded.weights.kind.mixes:
        decoded = decode_mixture(coded.weights, mixture_inputs_reference(coded, pixels, hits))
    else:
        codes = interpolate_codes_reference(coded, rows[pixels], hits.entry_voxel[pixels])
        decoded = decode(coded.weights, codes, hits.direction[pixels], hits.up[pixels], hits.ratio[pixels])
    coverage[pixels], luminance[pixels] = decoded
    return Prediction(coverage, luminance, rows >= 0)


def interpolate_codes_reference(coded: CodedOctree, rows: np.ndarray, entry_voxel: np.ndarray) -> np.ndarray:
    """Trilinear means (M, 10) float64 of the codes of coded nodes at points (M, 3) in the voxels, [0, 1]^3.

    The nodes are given as rows (M,) of `corner_rows`.
    """
    entry = np.asarray(entry_voxel, np.float64)[:, None, :]
    shares = np.where(OCTANTS == 1, entry, 1 - entry).prod(axis=-1)  # (M, 8)
    codes = coded.codes[corners_of(coded.corner_rows, rows)].astype(np.float64)  # (M, 8, 10)
    return np.einsum("mo,moc->mc", shares, codes)
