# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of training voxels, and of the parts of a scene held out for validation (methods 7.18, 7.21)."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.cells.morton import morton_decode
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.errors import PatchNetError

BLOCK_LEVEL = 3  # spatial blocks for validation are the cells of this level
_REPEATS = 16  # most draws per voxel of a level


def usable_nodes(octree: Octree, min_level: int, lookahead: int = DEFAULT_LOOKAHEAD) -> dict[int, np.ndarray]:
    """Nodes (n,) int64 with look-ahead by level, counted from the level's first.

    Raises PatchNetError if there are none.
    """
    ahead = octree.look_ahead(lookahead)
    nodes = {}
    for level in range(min_level, octree.depth - lookahead + 1):
        here = np.flatnonzero(ahead[octree.level(level)])
        if len(here):
            nodes[level] = here
    if not nodes:
        raise PatchNetError(
            f"The octree of depth {octree.depth} has no voxel with look-ahead from level {min_level} on: "
            f"use one of depth {min_level + lookahead} or more"
        )
    return nodes


def choose_voxels(octree: Octree, nodes: dict[int, np.ndarray], count: int, random: np.random.Generator) -> np.ndarray:
    """Voxels (count, 4) uint16 level, x, y, z of `nodes` by level, in random order.

    Half is uniform over voxels, half uniform over levels.
    """
    sizes = np.array([len(here) for here in nodes.values()], np.int64)
    shares = _even_shares(sizes, count)
    shares = shares + random.multinomial(count - shares.sum(), sizes / sizes.sum())
    parts = []
    for (level, here), share in zip(nodes.items(), shares, strict=True):
        picked = here[random.integers(0, len(here), share)]
        cells = morton_decode(octree.keys(level)[picked])
        parts.append(np.column_stack([np.full(share, level), cells]).astype(np.uint16))
    return random.permutation(np.concatenate(parts))


def _even_shares(sizes: np.ndarray, count: int) -> np.ndarray:
    """Voxels (L,) of `count` drawn uniformly over levels of `sizes` voxels (L,)."""
    return np.minimum(count // (2 * len(sizes)), _REPEATS * sizes)


def level_chances(sizes: np.ndarray, count: int) -> np.ndarray:
    """Probabilities (L,) of the levels when `count` voxels are drawn one by one as by `choose_voxels`."""
    even = _even_shares(sizes, count)
    return np.asarray((even + (count - even.sum()) * sizes / sizes.sum()) / count)


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
