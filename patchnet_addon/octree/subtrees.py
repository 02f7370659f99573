# SPDX-License-Identifier: GPL-3.0-or-later
"""Subtrees over the leaves of some blocks of space, from the blocks down, in the octree's compact form.

In a large scene only the leaves of one pass are held as sums; luminance is stored later, since the exposure needs all
leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .leaf_boxes import WHOLE, unpacked
from .levels import area_and_normal, merge_nodes, parents_of, stored_chroma, sums_of_level
from .side_levels import LeafSides, no_sides
from .voxelize import LeafSums


@dataclass(frozen=True, eq=False)
class Subtrees:
    """Nodes of consecutive blocks, level by level from `root_level` on; within a level in Morton order.

    root_keys: (r,) uint64 of the nonempty blocks. root_sums: (r, 4) float64, area and area * normal (x, y, z) in world
    units. Of each level: child_mask (n,) uint8, area_world (n,) float32, normal (n, 3) int8 as in `Octree`,
    leaf_luminance (l,) float32, means over its leaves before exposure, leaf_chroma (l, 2) uint8, or (l, 0) without
    colour, leaf_box (l, 3) uint8, and leaf_sides, empty unless sides are stored.
    """

    root_level: int
    root_keys: np.ndarray
    root_sums: np.ndarray
    child_mask: tuple[np.ndarray, ...]
    area_world: tuple[np.ndarray, ...]
    normal: tuple[np.ndarray, ...]
    leaf_luminance: tuple[np.ndarray, ...]
    leaf_chroma: tuple[np.ndarray, ...]
    leaf_box: tuple[np.ndarray, ...]
    leaf_sides: tuple[LeafSides, ...]


def subtrees(leaves: Sequence[LeafSums], root_level: int) -> Subtrees:
    """Nodes over leaves that lie on one or several levels from `root_level` on, no leaf within another one."""
    by_level = {part.level: part for part in leaves}
    width = leaves[0].sums.shape[1] if leaves else 5
    none = LeafSums(0, np.empty(0, np.uint64), np.empty((0, width), np.float32))
    keys, sums = none.keys, np.empty((0, 4), np.float64)
    levels = []
    for level in range(max(by_level, default=root_level), root_level - 1, -1):
        own = by_level.get(level, none)
        parents, mask = parents_of(keys)
        keys, mask = merge_nodes(own.keys, parents, mask)
        sums = sums_of_level(mask, sums, own.sums)
        luminance = own.sums[:, 1] / own.sums[:, 0]
        sides = own.sides or no_sides(colored=width > 5)
        levels.append((mask, *area_and_normal(sums), luminance, _chroma(own.sums), _boxes(own), sides))
    columns = (tuple(column) for column in zip(*reversed(levels), strict=True))
    return Subtrees(root_level, keys, sums, *columns)


def _boxes(leaves: LeafSums) -> np.ndarray:
    """Boxes (l, 3) uint8 of leaves, whole voxels if unknown."""
    return unpacked(np.full(len(leaves.keys), WHOLE, np.uint32)) if leaves.boxes is None else leaves.boxes


def _chroma(sums: np.ndarray) -> np.ndarray:
    """Chroma (l, 2) uint8 of leaf sums (l, 7), (l, 0) of sums without colour."""
    if sums.shape[1] == 5:
        return np.empty((len(sums), 0), np.uint8)
    return stored_chroma(sums[:, 1], sums[:, 5:])
