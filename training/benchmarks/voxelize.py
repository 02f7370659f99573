# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxelizer benchmark: ours beside Open3D's voxel grid.

Open3D marks the voxels that a triangle meets. Ours also clips the triangles, weighs and averages light and normals, and
builds the octree of all levels. Both get the triangles in memory and the same voxel size; light is constant, so that
no texture is read.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...patchnet_addon.octree.build import build_octree
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.surface.mesh import Fragments, TriangleBatch, TriangleMesh
from .open3d_peer import Open3DVoxels
from .timing import Comparison, compare

WARM_DEPTH = 5


class ConstantLight:
    """ShadingFn of constant light that counts the fragments it is asked about."""

    fragments = 0

    def __call__(self, _batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, np.ndarray]:
        """Luminance (F,) and opacity (F,)."""
        self.fragments += len(fragments)
        return np.full(len(fragments), 0.5, np.float32), np.ones(len(fragments), np.float32)


class OurVoxels:
    """Triangles (T, 3, 3) in memory, and the last octree made of them."""

    def __init__(self, corners_world: np.ndarray) -> None:
        """Run once at a small depth, which compiles all kernels."""
        self.mesh = TriangleMesh.from_arrays(corners_world)
        self.octree: Octree | None = None
        self.fragments = 0
        self.voxelize(Grid.around(self.mesh.bounds_world, WARM_DEPTH))

    def voxelize(self, grid: Grid) -> None:
        """Build the octree under constant light."""
        self.octree = None
        light = ConstantLight()
        self.octree = drain(build_octree(self.mesh, grid, light, exposure=1.0))
        self.fragments = light.fragments


def benchmark_voxelize(
    corners_world: np.ndarray, depth: int, repeats: int = 3, *, all_cores: bool = False
) -> Comparison:
    """Time both on triangles (T, 3, 3) at 2^depth cells along the longest axis.

    On one core in processor seconds, or on all in wall seconds; Open3D uses one thread in any case.
    Raises PatchNetError if Open3D cannot be imported, GeometryError if there is no surface.
    """
    ours = OurVoxels(corners_world)
    theirs = Open3DVoxels(corners_world, Grid.around(ours.mesh.bounds_world, WARM_DEPTH).voxel_size_world)
    grid = Grid.around(ours.mesh.bounds_world, depth)
    comparison = compare(
        "voxelize",
        lambda: ours.voxelize(grid),
        lambda: theirs.voxelize(grid.voxel_size_world),
        repeats,
        all_cores=all_cores,
        prepare=theirs.clear,
    )
    assert ours.octree is not None
    details = comparison.details | {
        "depth": depth,
        "triangles": len(corners_world),
        "ours_voxels": ours.octree.leaf_count,
        "ours_nodes": ours.octree.node_count,
        "ours_fragments": ours.fragments,
        "peer_voxels": theirs.voxel_count,
        "peer_name": theirs.name,
    }
    return replace(comparison, details=details)
