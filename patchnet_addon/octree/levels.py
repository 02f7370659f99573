# SPDX-License-Identifier: GPL-3.0-or-later
"""Build one level of an octree from the next finer one: its nodes and their contents.

Leaves may be on several levels, but no leaf is inside another one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..cells.morton import POPCOUNT
from ..cells.scales import NORMAL_SCALE
from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.kernels import kernel


def hierarchy(leaf_keys: Mapping[int, np.ndarray], depth: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes over leaves with ascending keys (n,) uint64 on each level up to `depth`.

    child_mask (nodes,) uint8 and first_child (nodes,) uint32, as in `Octree`.
    """
    masks: list[np.ndarray] = []
    none = np.empty(0, np.uint64)
    keys = none
    for level in range(depth, -1, -1):
        keys, mask = merge_nodes(leaf_keys.get(level, none), *parents_of(keys))
        masks.append(mask)
    child_mask = np.concatenate(masks[::-1])
    return child_mask, number_children(child_mask)


@kernel
def parents_of(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keys (p,) uint64 and child masks (p,) uint8 of the parents of nodes with ascending keys (n,)."""
    parents, mask = np.empty(len(keys), np.uint64), np.empty(len(keys), np.uint8)
    parent = -1
    for i in range(len(keys)):
        key = keys[i] >> np.uint64(3)
        if parent < 0 or parents[parent] != key:
            parent += 1
            parents[parent] = key
            mask[parent] = 0
        mask[parent] |= np.uint8(1) << np.uint8(keys[i] & np.uint64(7))
    return parents[: parent + 1].copy(), mask[: parent + 1].copy()


@kernel
def merge_nodes(leaves: np.ndarray, inner: np.ndarray, inner_mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ascending keys and child masks of all nodes of a level: its leaves (l,) and its inner nodes (i,)."""
    if len(inner) == 0:
        return leaves, np.zeros(len(leaves), np.uint8)
    if len(leaves) == 0:
        return inner, inner_mask
    count = len(leaves) + len(inner)
    keys, mask = np.empty(count, np.uint64), np.empty(count, np.uint8)
    i = 0
    j = 0
    for node in range(count):
        if j == len(inner) or (i < len(leaves) and leaves[i] < inner[j]):
            keys[node] = leaves[i]
            mask[node] = 0
            i += 1
        else:
            keys[node] = inner[j]
            mask[node] = inner_mask[j]
            j += 1
    return keys, mask


def number_children(child_mask: np.ndarray) -> np.ndarray:
    """Index (n,) uint32 of each node's first child: children are in the order of their parents.

    Raises SettingError for more nodes than 32-bit indices allow.
    """
    check_count(len(child_mask), UINT32_COUNT, "nodes", NODE_ADVICE)
    counts = POPCOUNT[child_mask]
    first_child = np.cumsum(counts, dtype=np.uint32)
    first_child -= counts
    first_child += np.uint32(1)
    return first_child


@kernel
def sums_of_level(child_mask, child_area, child_normal, leaf_area, leaf_normal):
    """Area (n,) and area * normal (n, 3) float64 of a level's nodes in order: their children's, or leaves' own.

    child_area, child_normal: (c,) and (c, 3) of the level below; leaf_area, leaf_normal: (l,) and (l, 3) of its leaves.
    """
    area, normal = np.zeros(len(child_mask), np.float64), np.zeros((len(child_mask), 3), np.float64)
    leaf = 0
    child = 0
    for node in range(len(child_mask)):
        mask = child_mask[node]
        if mask == 0:
            area[node] = leaf_area[leaf]
            for axis in range(3):
                normal[node, axis] = leaf_normal[leaf, axis]
            leaf += 1
        while mask:
            area[node] += child_area[child]
            for axis in range(3):
                normal[node, axis] += child_normal[child, axis]
            child += 1
            mask &= mask - np.uint8(1)
    return area, normal


@kernel
def area_and_normal(area_sums: np.ndarray, normal_sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stored area (n,) float32 and mean normal (n, 3) int8 of area (n,) and area * normal (n, 3)."""
    area, normal = np.empty(len(area_sums), np.float32), np.empty((len(area_sums), 3), np.int8)
    for i in range(len(area_sums)):
        area[i] = area_sums[i]
        for axis in range(3):
            mean = normal_sums[i, axis] / area_sums[i]
            normal[i, axis] = np.rint(min(max(mean, -1.0), 1.0) * NORMAL_SCALE)
    return area, normal


@kernel
def means_of_level(
    child_mask: np.ndarray, child_area: np.ndarray, child_values: np.ndarray, leaf_values: np.ndarray
) -> np.ndarray:
    """Values (n, k) float32 of a level's nodes in order: area-weighted means of their children's, or a leaf's own."""
    values = np.empty((len(child_mask), leaf_values.shape[1]), np.float32)
    leaf = 0
    first = np.int64(0)
    for node in range(len(child_mask)):
        last = first + np.int64(POPCOUNT[child_mask[node]])
        for column in range(leaf_values.shape[1]):
            total = 0.0
            area = 0.0
            for child in range(first, last):
                total += float(child_area[child]) * float(child_values[child, column])
                area += float(child_area[child])
            values[node, column] = total / area if last > first else leaf_values[leaf, column]
        leaf += 1 if last == first else 0
        first = last
    return values
