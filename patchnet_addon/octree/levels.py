# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels that make the levels of an octree from its leaves, one pass over each level."""

from __future__ import annotations

import numpy as np

from ..kernels import device, serial_kernel
from .octree import LUMINANCE_SCALE, NORMAL_SCALE


@serial_kernel
def count_levels(keys, depth):  # type: ignore[no-untyped-def]
    """Nodes (depth + 1,) int64 of each level over leaves with ascending `keys` (n,) uint64."""
    counts = np.ones(depth + 1, np.int64)
    for i in range(1, len(keys)):
        different = keys[i] ^ keys[i - 1]
        level = depth
        while different > 0:
            counts[level] += 1
            different >>= np.uint64(3)
            level -= 1
    return counts


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
def add_to_parents(keys, sums, exposure, parent_keys, parent_sums, child_mask):  # type: ignore[no-untyped-def]
    """Fill keys, sums (zero before) and child masks (zero before) of the next coarser level."""
    parent = -1
    for i in range(len(keys)):
        key = keys[i] >> np.uint64(3)
        if parent < 0 or parent_keys[parent] != key:
            parent += 1
            parent_keys[parent] = key
        child_mask[parent] |= np.uint8(1) << np.uint8(keys[i] & np.uint64(7))
        area = float(sums[i, 0])
        parent_sums[parent, 0] += area
        parent_sums[parent, 1] += area * _mean_luminance(sums, i, exposure)
        for axis in range(3):
            parent_sums[parent, 2 + axis] += sums[i, 2 + axis]


@serial_kernel
def number_children(child_mask, first_child):  # type: ignore[no-untyped-def]
    """Index of each node's first child: children of all nodes stand in the order of their parents."""
    child = 1
    for node in range(len(child_mask)):
        first_child[node] = child
        mask = child_mask[node]
        while mask:
            child += 1
            mask &= mask - np.uint8(1)
