# SPDX-License-Identifier: GPL-3.0-or-later
"""The levels of an octree from its leaves: first which nodes there are, then what they hold, one pass over each level.

Leaves may lie on several levels, as long as no leaf lies in another one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..kernels import device, serial_kernel
from .octree import LUMINANCE_SCALE, NORMAL_SCALE


def hierarchy(leaf_keys: Mapping[int, np.ndarray], depth: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes over leaves with ascending keys (n,) uint64 on each level up to `depth`.

    Returns level_start (depth + 2,) int64, child_mask (nodes,) uint8 and first_child (nodes,) uint32, as `Octree`
    holds them.
    """
    masks: list[np.ndarray] = []
    none = np.empty(0, np.uint64)
    keys, mask = none, np.empty(0, np.uint8)  # of the level below
    for level in range(depth, -1, -1):
        parents = np.empty(len(keys), np.uint64)
        parent_mask = np.empty(len(keys), np.uint8)
        count = _parents(keys, parents, parent_mask)
        leaves = leaf_keys.get(level, none)
        keys, mask = np.empty(count + len(leaves), np.uint64), np.empty(count + len(leaves), np.uint8)
        _merge(leaves, parents[:count], parent_mask[:count], keys, mask)
        masks.append(mask)
    level_start = np.concatenate([[0], np.cumsum([len(mask) for mask in reversed(masks)])]).astype(np.int64)
    child_mask = np.concatenate(masks[::-1])
    first_child = np.empty(len(child_mask), np.uint32)
    _number_children(child_mask, first_child)
    return level_start, child_mask, first_child


@serial_kernel
def _parents(keys, parents, mask):  # type: ignore[no-untyped-def]
    """Keys and child masks of the parents of nodes with ascending keys; returns how many there are."""
    parent = -1
    for i in range(len(keys)):
        key = keys[i] >> np.uint64(3)
        if parent < 0 or parents[parent] != key:
            parent += 1
            parents[parent] = key
            mask[parent] = 0
        mask[parent] |= np.uint8(1) << np.uint8(keys[i] & np.uint64(7))
    return parent + 1


@serial_kernel
def _merge(leaves, inner, inner_mask, keys, mask):  # type: ignore[no-untyped-def]
    """Fill keys and masks of a level, in order, with its leaves and its inner nodes."""
    i = 0
    j = 0
    for node in range(len(keys)):
        if j == len(inner) or (i < len(leaves) and leaves[i] < inner[j]):
            keys[node] = leaves[i]
            mask[node] = 0
            i += 1
        else:
            keys[node] = inner[j]
            mask[node] = inner_mask[j]
            j += 1


@serial_kernel
def _number_children(child_mask, first_child):  # type: ignore[no-untyped-def]
    """Index of each node's first child: children of all nodes stand in the order of their parents."""
    child = 1
    for node in range(len(child_mask)):
        first_child[node] = child
        mask = child_mask[node]
        while mask:
            child += 1
            mask &= mask - np.uint8(1)


@device
def _mean_luminance(sums, i, exposure):  # type: ignore[no-untyped-def]
    """Mean luminance of node i, times exposure, in [0, 1]."""
    return min(max(float(sums[i, 1]) / float(sums[i, 0]) * exposure, 0.0), 1.0)


@serial_kernel
def round_means(sums, exposure, area, luminance, normal):  # type: ignore[no-untyped-def]
    """Sums (n, 5) of one level -> area (n,), luminance (n,) and normal (n, 3) as the octree stores them."""
    for i in range(len(sums)):
        area[i] = sums[i, 0]
        luminance[i] = np.rint(_mean_luminance(sums, i, exposure) * LUMINANCE_SCALE)
        for axis in range(3):
            mean = float(sums[i, 2 + axis]) / float(sums[i, 0])
            normal[i, axis] = np.rint(min(max(mean, -1.0), 1.0) * NORMAL_SCALE)


@serial_kernel
def sums_of_level(child_mask, child_sums, child_exposure, leaf_sums, exposure, sums):  # type: ignore[no-untyped-def]
    """Fill sums (n, 5) float64, zero before, of a level's nodes in order: of children for inner nodes, else a leaf's.

    child_sums, leaf_sums: (c, 5) and (l, 5), all in the order of nodes. The exposures are what luminance was not yet
    multiplied with; it is then in [0, 1].
    """
    leaf = 0
    child = 0
    for node in range(len(child_mask)):
        mask = child_mask[node]
        if mask == 0:
            sums[node, 0] = leaf_sums[leaf, 0]
            sums[node, 1] = float(leaf_sums[leaf, 0]) * _mean_luminance(leaf_sums, leaf, exposure)
            for axis in range(3):
                sums[node, 2 + axis] = leaf_sums[leaf, 2 + axis]
            leaf += 1
        while mask:
            area = float(child_sums[child, 0])
            sums[node, 0] += area
            sums[node, 1] += area * _mean_luminance(child_sums, child, child_exposure)
            for axis in range(3):
                sums[node, 2 + axis] += child_sums[child, 2 + axis]
            child += 1
            mask &= mask - np.uint8(1)
