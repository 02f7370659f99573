# SPDX-License-Identifier: GPL-3.0-or-later
"""Lookups for tests: boxes of nodes, frames of rays, luminances of cells."""

from __future__ import annotations

import numpy as np

from patchnet.patchnet_addon.cells.leaf_boxes import STEPS
from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.codes.brick import EMPTY
from patchnet.patchnet_addon.codes.corner_cells import BASE, BASE_STEPS, FACES, SLOPE, SLOPE_BITS, SLOPE_STEPS
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD


def fits_pixel_of(voxel_side: np.ndarray | float, pixel_side: np.ndarray | float) -> np.ndarray:
    """Reference of `fits_pixel`: (N,) bool."""
    return np.asarray(voxel_side) < 2.0 * np.asarray(pixel_side)


def node_at(octree: Octree, level: int, cells: np.ndarray) -> np.ndarray:
    """Node index (N,) int64 of each cell (N, 3) of a level, -1 for an empty or outside cell."""
    inside = ((cells >= 0) & (cells < (1 << level))).all(axis=-1)
    wanted, keys = morton_encode(np.where(inside[..., None], cells, 0)), octree.keys(level)
    position = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(inside & (keys[position] == wanted), position + octree.level_start[level], -1)


def covering_nodes_reference(octree: Octree, level: int, cells: np.ndarray) -> np.ndarray:
    """Reference of `covering_nodes` by one search of the sorted keys per level, from the finest up."""
    nodes = np.full(len(cells), EMPTY, np.int64)
    for coarser in range(min(level, octree.depth), -1, -1):
        found = node_at(octree, coarser, np.asarray(cells) >> (level - coarser))
        leaf = (found >= 0) & (octree.child_mask[found] == 0)
        accepted = (nodes < 0) & (leaf | ((found >= 0) & (coarser == level)))
        nodes[accepted] = found[accepted]
    return nodes


def brick_nodes(octree: Octree, level: int, cell: np.ndarray, lookahead: int = DEFAULT_LOOKAHEAD) -> np.ndarray:
    """Reference of `fill_brick`: nodes (S, S, S) int64 in the order z, y, x, -1 for empty, by look-ups of keys.

    S is 3 * 2^lookahead.
    """
    side = 1 << lookahead
    axis = np.arange(3 * side)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    fine = np.stack([x, y, z], axis=-1).reshape(-1, 3) + (np.asarray(cell, np.int64) - 1) * side  # (S^3, 3)
    return covering_nodes_reference(octree, level + lookahead, fine).reshape(3 * side, 3 * side, 3 * side)


def face_luminances(words: np.ndarray) -> np.ndarray:
    """Luminances (..., 6) float32 of the faces of cells; those of empty cells mean nothing."""
    words = np.asarray(words, np.int64)
    base = (words >> BASE & 255) / BASE_STEPS
    faces = np.empty((*words.shape, FACES), np.float32)
    for axis in range(3):
        field = words >> (SLOPE + SLOPE_BITS * axis) & (1 << SLOPE_BITS) - 1
        steps = (field - SLOPE_STEPS) / SLOPE_STEPS
        half = 0.5 * steps * np.abs(steps)
        for side, root in enumerate((base - half, base + half)):
            faces[..., 2 * axis + side] = np.clip(root, 0, 1) ** 2
    return faces


def ray_frames(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number (N,), axes (N, 3) and signs (N, 3) float32 of the frames of directions (N, 3).

    Component k of a vector v in the frame is sign[axes[k]] * v[axes[k]]; signs are given in the order of the frame.
    Reference of `ray_frame`.
    """
    axes = np.argsort(-np.abs(direction), axis=1, kind="stable")
    flips = (direction < 0) @ np.array([1, 2, 4])
    signs = np.where(np.take_along_axis(direction, axes, 1) < 0, np.float32(-1), np.float32(1))
    return 8 * (2 * axes[:, 0] + (axes[:, 1] > axes[:, 2])) + flips, axes, signs


def box_bounds(boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corners (n, 3) float64 of boxes (n, 3) uint8, in voxels from the leaf's lowest corner."""
    return (boxes & 15) / STEPS, ((boxes >> 4) + 1.0) / STEPS


def covered_shares(boxes: np.ndarray) -> np.ndarray:
    """Shares (n, 3) float32 of their voxel's faces that boxes (n, 3) uint8 cover as seen along each axis.

    Reference of `covered_steps`.
    """
    x, y, z = (1 + (boxes >> 4).astype(np.int64) - (boxes & 15)).T
    return (np.stack([y * z, x * z, x * y], axis=1) / STEPS**2).astype(np.float32)
