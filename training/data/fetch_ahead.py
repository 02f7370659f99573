# SPDX-License-Identifier: GPL-3.0-or-later
"""Prefetch of an octree's nodes around voxels that are gathered soon, for kernels.

Voxels of a step lie anywhere in gigabytes of octrees, and each is found by nodes that name one another: a processor
that comes to a voxel waits for memory again and again. So nodes are asked for level by level, `AHEAD` voxels before
each level is read.
"""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.runtime.kernels import lean_device
from ...patchnet_addon.runtime.prefetch import prefetch

AHEAD = 2


@lean_device
def fetch_nodes(nodes, around):
    """Begin to fetch the nodes around a voxel; around: (27,) see `Brick`."""
    for block in range(len(around)):
        node = np.int64(around[block])
        if node >= 0:
            prefetch(nodes.child_mask, node)
            prefetch(nodes.first_child, node)


@lean_device
def fetch_children(nodes, around):
    """Begin to fetch their children; the nodes are there."""
    for block in range(len(around)):
        node = np.int64(around[block])
        if node >= 0:
            child = np.int64(nodes.first_child[node])
            prefetch(nodes.child_mask, child)
            prefetch(nodes.first_child, child)


@lean_device
def fetch_cells(nodes, values, width, around):
    """Begin to fetch the first of the `width` values that each node has, of their children's children."""
    for block in range(len(around)):
        node = np.int64(around[block])
        if node < 0:
            continue
        mask, child = np.int64(nodes.child_mask[node]), np.int64(nodes.first_child[node])
        while mask != 0:
            prefetch(values, width * np.int64(nodes.first_child[child]))
            child += 1
            mask &= mask - 1
