# SPDX-License-Identifier: GPL-3.0-or-later
"""Build one level of an octree from the next finer one: its nodes and their contents.

Leaves may be on several levels, but no leaf is inside another one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..runtime.bounds import NODE_ADVICE, UINT32_COUNT, check_count
from ..runtime.kernels import kernel
from ..surface.chroma_kernels import decode_color, encode_shares
from .octree import LUMINANCE_SCALE, NORMAL_SCALE


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


def parents_of(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keys (p,) uint64 and child masks (p,) uint8 of the parents of nodes with ascending keys (n,)."""
    parents, mask = np.empty(len(keys), np.uint64), np.empty(len(keys), np.uint8)
    count = _parents(keys, parents, mask)
    return parents[:count].copy(), mask[:count].copy()


def merge_nodes(leaves: np.ndarray, inner: np.ndarray, inner_mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ascending keys and child masks of all nodes of a level: its leaves (l,) and its inner nodes (i,)."""
    if len(inner) == 0:
        return leaves, np.zeros(len(leaves), np.uint8)
    if len(leaves) == 0:
        return inner, inner_mask
    count = len(leaves) + len(inner)
    keys, mask = np.empty(count, np.uint64), np.empty(count, np.uint8)
    _merge(leaves, inner, inner_mask, keys, mask)
    return keys, mask


def number_children(child_mask: np.ndarray) -> np.ndarray:
    """Index (n,) uint32 of each node's first child: children are in the order of their parents.

    Raises SettingError for more nodes than 32-bit indices allow.
    """
    check_count(len(child_mask), UINT32_COUNT, "nodes", NODE_ADVICE)
    first_child = np.empty(len(child_mask), np.uint32)
    _number_children(child_mask, first_child)
    return first_child


def sums_of_level(child_mask: np.ndarray, child_sums: np.ndarray, leaf_sums: np.ndarray) -> np.ndarray:
    """Area and area * normal (n, 4) float64 of a level's nodes in order: their children's, or their own for leaves.

    child_sums: (c, 4) of the level below. leaf_sums: (l, 5 or 7) of the level's leaves, as in `LeafSums`.
    """
    sums = np.zeros((len(child_mask), 4), np.float64)
    _sums(child_mask, child_sums, leaf_sums, sums)
    return sums


def area_and_normal(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stored area (n,) float32 and mean normal (n, 3) int8 of sums (n, 4)."""
    normal = np.empty((len(sums), 3), np.int8)
    _round_normals(sums, normal)
    return sums[:, 0].astype(np.float32), normal


def luminance_of_level(
    child_mask: np.ndarray, child_area: np.ndarray, child_luminance: np.ndarray, leaf_luminance: np.ndarray
) -> np.ndarray:
    """Luminance (n,) float32 of a level's nodes in order: the area-weighted mean of their children, or a leaf's own."""
    luminance = np.empty(len(child_mask), np.float32)
    _mean_luminance(child_mask, child_area, child_luminance, leaf_luminance, luminance)
    return luminance


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
    _mean_red_blue(child_mask, child_area, child_red_blue, leaf_luminance, leaf_chroma, red_blue)
    return red_blue


def stored_chroma(luminance: np.ndarray, red_blue: np.ndarray) -> np.ndarray:
    """Stored chroma (n, 2) uint8 of luminance (n,), red and blue (n, 2), of any brightness."""
    stored = np.empty((len(luminance), 2), np.uint8)
    _store_chroma(luminance, red_blue, stored)
    return stored


def stored_luminance(luminance: np.ndarray) -> np.ndarray:
    """Stored luminance (n,) uint16 of values in [0, 1]."""
    stored = np.empty(len(luminance), np.uint16)
    _store_luminance(luminance, stored)
    return stored


@kernel
def _parents(keys, parents, mask):  # type: ignore[no-untyped-def]
    """Fill `parents` and `mask`; returns the number of parents."""
    parent = -1
    for i in range(len(keys)):
        key = keys[i] >> np.uint64(3)
        if parent < 0 or parents[parent] != key:
            parent += 1
            parents[parent] = key
            mask[parent] = 0
        mask[parent] |= np.uint8(1) << np.uint8(keys[i] & np.uint64(7))
    return parent + 1


@kernel
def _merge(leaves, inner, inner_mask, keys, mask):  # type: ignore[no-untyped-def]
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


@kernel
def _number_children(child_mask, first_child):  # type: ignore[no-untyped-def]
    child = 1
    for node in range(len(child_mask)):
        first_child[node] = child
        mask = child_mask[node]
        while mask:
            child += 1
            mask &= mask - np.uint8(1)


@kernel
def _sums(child_mask, child_sums, leaf_sums, sums):  # type: ignore[no-untyped-def]
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


@kernel
def _round_normals(sums, normal):  # type: ignore[no-untyped-def]
    for i in range(len(sums)):
        for axis in range(3):
            mean = sums[i, 1 + axis] / sums[i, 0]
            normal[i, axis] = np.rint(min(max(mean, -1.0), 1.0) * NORMAL_SCALE)


@kernel
def _mean_luminance(child_mask, child_area, child_luminance, leaf_luminance, luminance):  # type: ignore[no-untyped-def]
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


@kernel
def _store_luminance(luminance, stored):  # type: ignore[no-untyped-def]
    for i in range(len(luminance)):
        stored[i] = np.rint(float(luminance[i]) * LUMINANCE_SCALE)


@kernel
def _mean_red_blue(child_mask, child_area, child_red_blue, leaf_luminance, leaf_chroma, red_blue):  # type: ignore[no-untyped-def]
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


@kernel
def _store_chroma(luminance, red_blue, stored):  # type: ignore[no-untyped-def]
    for i in range(len(luminance)):
        stored[i, 0], stored[i, 1] = encode_shares(float(luminance[i]), red_blue[i, 0], red_blue[i, 1])
