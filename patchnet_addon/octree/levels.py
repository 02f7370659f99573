# SPDX-License-Identifier: GPL-3.0-or-later
"""Build one level of an octree from the next finer one: its nodes and their contents.

Leaves may be on several levels, but no leaf is inside another one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.kernels import kernel
from .octree import LUMINANCE_SCALE, NORMAL_SCALE, POPCOUNT
from .side_kernels import decode_color, encode_shares


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
def sums_of_level(child_mask: np.ndarray, child_sums: np.ndarray, leaf_sums: np.ndarray) -> np.ndarray:
    """Area and area * normal (n, 4) float64 of a level's nodes in order: their children's, or their own for leaves.

    child_sums: (c, 4) of the level below. leaf_sums: (l, 5 or 7) of the level's leaves, as in `LeafSums`.
    """
    sums = np.zeros((len(child_mask), 4), np.float64)
    leaf = 0
    child = 0
    for node in range(len(child_mask)):
        mask = child_mask[node]
        if mask == 0:
            sums[node, 0] = leaf_sums[leaf, 0]
            for axis in range(3):
                sums[node, 1 + axis] = leaf_sums[leaf, 2 + axis]
            leaf += 1
        while mask:
            for column in range(4):
                sums[node, column] += child_sums[child, column]
            child += 1
            mask &= mask - np.uint8(1)
    return sums


@kernel
def area_and_normal(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stored area (n,) float32 and mean normal (n, 3) int8 of sums (n, 4)."""
    area, normal = np.empty(len(sums), np.float32), np.empty((len(sums), 3), np.int8)
    for i in range(len(sums)):
        area[i] = sums[i, 0]
        for axis in range(3):
            mean = sums[i, 1 + axis] / sums[i, 0]
            normal[i, axis] = np.rint(min(max(mean, -1.0), 1.0) * NORMAL_SCALE)
    return area, normal


@kernel
def luminance_of_level(
    child_mask: np.ndarray, child_area: np.ndarray, child_luminance: np.ndarray, leaf_luminance: np.ndarray
) -> np.ndarray:
    """Luminance (n,) float32 of a level's nodes in order: the area-weighted mean of their children, or a leaf's own."""
    luminance = np.empty(len(child_mask), np.float32)
    leaf = 0
    child = 0
    for node in range(len(child_mask)):
        mask = child_mask[node]
        if mask == 0:
            luminance[node] = leaf_luminance[leaf]
            leaf += 1
            continue
        total = 0.0
        area = 0.0
        while mask:
            total += float(child_area[child]) * float(child_luminance[child])
            area += float(child_area[child])
            child += 1
            mask &= mask - np.uint8(1)
        luminance[node] = total / area
    return luminance


@kernel
def red_blue_of_level(
    child_mask: np.ndarray,
    child_area: np.ndarray,
    child_red_blue: np.ndarray,
    leaf_luminance: np.ndarray,
    leaf_chroma: np.ndarray,
) -> np.ndarray:
    """Red and blue (n, 2) float32 of a level's nodes in order.

    The area-weighted means of their children's (c, 2), or for leaves those of their luminance (l,) and chroma (l, 2)
    uint8.
    """
    red_blue = np.empty((len(child_mask), 2), np.float32)
    leaf = 0
    child = 0
    for node in range(len(child_mask)):
        mask = child_mask[node]
        if mask == 0:
            red, _, blue = decode_color(float(leaf_luminance[leaf]), leaf_chroma[leaf, 0], leaf_chroma[leaf, 1])
            red_blue[node, 0] = red
            red_blue[node, 1] = blue
            leaf += 1
            continue
        red = 0.0
        blue = 0.0
        area = 0.0
        while mask:
            share = float(child_area[child])
            red += share * float(child_red_blue[child, 0])
            blue += share * float(child_red_blue[child, 1])
            area += share
            child += 1
            mask &= mask - np.uint8(1)
        red_blue[node, 0] = red / area
        red_blue[node, 1] = blue / area
    return red_blue


@kernel
def stored_chroma(luminance: np.ndarray, red_blue: np.ndarray) -> np.ndarray:
    """Stored chroma (n, 2) uint8 of luminance (n,), red and blue (n, 2), of any brightness."""
    stored = np.empty((len(luminance), 2), np.uint8)
    for i in range(len(luminance)):
        stored[i, 0], stored[i, 1] = encode_shares(float(luminance[i]), red_blue[i, 0], red_blue[i, 1])
    return stored


@kernel
def stored_luminance(luminance: np.ndarray) -> np.ndarray:
    """Stored luminance (n,) uint16 of values in [0, 1]."""
    stored = np.empty(len(luminance), np.uint16)
    for i in range(len(luminance)):
        stored[i] = np.rint(float(luminance[i]) * LUMINANCE_SCALE)
    return stored
