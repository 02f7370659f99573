# SPDX-License-Identifier: GPL-3.0-or-later
"""Our voxelizer beside Open3D's `VoxelGrid.create_from_triangle_mesh` (https://www.open3d.org).

Open3D marks the voxels that a triangle meets. Ours also clips the triangles, weighs and averages light and normals, and
builds the octree of all levels. Both get the triangles in memory and the same voxel size; light is constant, so that
no texture is read.
"""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from ...patchnet_addon.errors import PatchNetError
from ...patchnet_addon.octree.build import build_octree
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.mesh import Fragments, TriangleBatch, TriangleMesh
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.progress import drain
from .timing import Comparison, compare

_WARM_TRIANGLES = 1000


def benchmark_voxelize(corners_world: np.ndarray, depth: int, repeats: int = 3) -> Comparison:
    """Time both on triangles (T, 3, 3) at 2^depth cells along the longest axis.

    Raises PatchNetError if Open3D cannot be imported, GeometryError if there is no surface.
    """
    open3d = import_open3d()
    mesh = TriangleMesh.from_arrays(corners_world)
    grid = Grid.around(mesh.bounds_world, depth)
    results: dict[str, Any] = {}

    def ours() -> None:
        results["octree"] = voxelize_alone(mesh, grid)

    def peer() -> None:
        results["voxels"] = open3d.geometry.VoxelGrid.create_from_triangle_mesh(theirs, grid.voxel_world)

    first = TriangleMesh.from_arrays(corners_world[:_WARM_TRIANGLES])
    voxelize_alone(first, Grid.around(mesh.bounds_world, min(depth, 6)))  # compiles
    theirs = _their_mesh(open3d, corners_world)
    comparison = compare("voxelize", ours, peer, repeats)
    details = comparison.details | {
        "depth": depth,
        "triangles": len(corners_world),
        "ours_voxels": results["octree"].leaf_count,
        "ours_nodes": results["octree"].node_count,
        "peer_voxels": len(results["voxels"].get_voxels()),
        "peer_name": f"Open3D {open3d.__version__}",
    }
    return replace(comparison, details=details)


def voxelize_alone(mesh: TriangleMesh, grid: Grid) -> Octree:
    """Octree of `mesh` under constant light."""
    return drain(build_octree(mesh, grid, _constant_shade, exposure=1.0))


def _constant_shade(_batch: TriangleBatch, fragments: Fragments) -> tuple[np.ndarray, np.ndarray]:
    return np.full(len(fragments), 0.5, np.float32), np.ones(len(fragments), np.float32)


def import_open3d() -> ModuleType:
    """Open3D, or a PatchNetError that says how to get it."""
    try:
        import open3d
    except (ImportError, OSError) as cause:
        raise PatchNetError(
            f"Open3D cannot be imported ({cause}): install patchnet-blender[peers], and on Debian libusb-1.0-0"
        ) from cause
    return open3d


def _their_mesh(open3d: ModuleType, corners_world: np.ndarray) -> Any:
    vertices = open3d.utility.Vector3dVector(np.ascontiguousarray(corners_world, np.float64).reshape(-1, 3))
    triangles = np.arange(3 * len(corners_world), dtype=np.int32).reshape(-1, 3)
    return open3d.geometry.TriangleMesh(vertices, open3d.utility.Vector3iVector(triangles))
