# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches of triangles, and the voxelizer's sums of leaves."""

import numpy as np

from patchnet.patchnet_addon.octree.voxelize import LeafSums, voxelize
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import TriangleBatch


def all_leaves(leaves, _block_level):
    """Keep everything, for `voxelize`."""
    return leaves


def leaves_of(source, grid, shade, **settings):
    """Leaf sums of each level with leaves, coarse first, all passes together."""
    passes = drain(voxelize(source, grid, shade, all_leaves, **settings))
    parts = [part for leaves in passes for part in leaves]
    return [_joined(level, parts) for level in sorted({part.level for part in parts})]


def in_batches(corners, cuts, uvs=None, materials=None):
    """Batches of triangles (T, 3, 3) that are cut at the numbers `cuts`."""
    uvs = np.zeros((len(corners), 3, 2), np.float32) if uvs is None else uvs
    materials = np.zeros(len(corners), np.int32) if materials is None else materials
    ranges = zip([0, *cuts], [*cuts, len(corners)], strict=True)
    return tuple(TriangleBatch(corners[a:b], uvs[a:b], materials[a:b], int(a)) for a, b in ranges)


def _joined(level, parts):
    chosen = [part for part in parts if part.level == level]
    return LeafSums(
        level, np.concatenate([part.keys for part in chosen]), np.concatenate([part.sums for part in chosen])
    )
