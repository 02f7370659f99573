# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of training voxels, and of the parts of a scene held out for validation (methods 7.18, 7.21)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.cells.morton import morton_decode
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import PatchNetError
from ..settings import VIEWS

BLOCK_LEVEL = 3  # spatial blocks for validation are the cells of this level
_REPEATS = 16  # most draws per voxel of a level


@dataclass(frozen=True)
class SampleSettings:
    """Settings of drawing samples.

    views: random views per voxel. min_level: coarsest level used. held_out: share of spatial blocks kept for
    validation (methods 7.21). lookahead: levels between a voxel and the cells that are seen, 1 to 3.
    """

    views: int = VIEWS
    min_level: int = 5
    held_out: float = 0.05
    seed: int = 0
    lookahead: int = DEFAULT_LOOKAHEAD


@dataclass(frozen=True, eq=False)
class VoxelLists:
    """Candidate voxels of T octrees of up to L levels.

    voxel: (G, 4) uint16 level, x, y, z, by octree and level. start: (T, L + 1) int64, start of each level. below: (T,
    L) float64, cumulative probabilities of levels.
    """

    voxel: np.ndarray
    start: np.ndarray
    below: np.ndarray

    @classmethod
    def of(cls, candidates: Sequence[Sequence[np.ndarray]], count: int) -> VoxelLists:
        """Lists of the voxels (n, 4) of each octree by level; count: as of `level_chances`."""
        levels = max(len(each) for each in candidates)
        sizes = np.zeros((len(candidates), levels), np.int64)
        below = np.ones((len(candidates), levels))
        for number, each in enumerate(candidates):
            sizes[number, : len(each)] = [len(voxel) for voxel in each]
            below[number, : len(each)] = np.cumsum(level_chances(sizes[number, : len(each)], count))
        ends = np.cumsum(sizes).reshape(sizes.shape)
        start = np.concatenate([ends[:, :1] - sizes[:, :1], ends], axis=1)
        return cls(np.concatenate([voxel for each in candidates for voxel in each]), start, below)


def level_chances(sizes: np.ndarray, count: int) -> np.ndarray:
    """Chances (L,) of levels of `sizes` voxels (L,) for `count` draws: half even over voxels, half over levels."""
    even = np.minimum(count // (2 * len(sizes)), _REPEATS * sizes)
    return np.asarray((even + (count - even.sum()) * sizes / sizes.sum()) / count)


def candidates(octree: Octree, settings: SampleSettings) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Voxels (n, 4) uint16 with look-ahead by level, for training and for validation, see `held_out_voxels`.

    Raises PatchNetError if there are none for training.
    """
    first, lookahead = settings.min_level, settings.lookahead
    ahead = octree.look_ahead(lookahead)
    training, validation = [], []
    for level in range(first, octree.depth - lookahead + 1):
        nodes = np.flatnonzero(ahead[octree.level(level)])
        if not len(nodes):
            continue
        cells = morton_decode(octree.keys(level)[nodes])
        voxel = np.column_stack([np.full(len(nodes), level), cells]).astype(np.uint16)
        outside, inside = held_out_voxels(octree, voxel, settings.held_out, settings.seed)
        training.append(voxel[outside])
        validation.append(voxel[inside])
    if not sum(map(len, training + validation)):
        raise PatchNetError(
            f"The octree of depth {octree.depth} has no voxel with look-ahead from level {first} on: "
            f"use one of depth {first + lookahead} or more"
        )
    if not sum(map(len, training)):
        raise PatchNetError("All voxels of an octree are held out for validation: lower the held-out share")
    return training, validation


def held_out_voxels(octree: Octree, voxels: np.ndarray, share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Masks (n,) of voxels (n, 4): training and validation.

    A random `share` of the occupied spatial blocks is held out. Voxels whose patch crosses the border of a held-out
    block are in neither, so that no cell occurs in both.
    """
    blocks = octree.cells(BLOCK_LEVEL)
    number = int(np.ceil(share * len(blocks))) if share > 0 else 0
    held = np.zeros((1 << BLOCK_LEVEL,) * 3, bool)
    x, y, z = np.random.default_rng(seed + 1).permutation(blocks)[:number].T
    held[x, y, z] = True
    level = voxels[:, 0].astype(np.int64)
    side = 2.0 ** -level[:, None].astype(np.float64)
    low = voxels[:, 1:].astype(np.float64) * side
    touched = np.zeros(len(voxels), np.int64)
    for corner in range(8):  # a patch spans less than two blocks along an axis: testing its corners suffices
        reach = np.array([corner & 1, (corner >> 1) & 1, corner >> 2]) * 3.0 - 1.0
        point = low + reach * side * (1 - 1e-9) + np.where(reach < 0, 1e-9, 0) * side
        cell = np.clip(np.floor(point * (1 << BLOCK_LEVEL)), 0, (1 << BLOCK_LEVEL) - 1).astype(np.int64)
        touched += held[cell[:, 0], cell[:, 1], cell[:, 2]]
    return touched == 0, touched == 8
