# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree of triangles in memory against Open3D's `VoxelGrid.create_from_triangle_mesh` (https://www.open3d.org).

Open3D marks the voxels that overlap a triangle, in one thread. PatchNet also clips the triangles, computes weighted
means of light and normals, and builds all levels of the octree. Both get the same triangles and voxel size.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.threads import limit_threads
from ...patchnet_addon.surface.mesh import TriangleMesh
from ...training.benchmarks.timing import comparison, timed
from .inputs import SHELLS, imported, read_triangles, voxelized

_WARM_DEPTH = 5


def import_open3d() -> ModuleType:
    """Open3D; raises PatchNetError with the command to install it."""
    return imported("Open3D", "open3d", "patchnet-blender[peers], and on Debian libusb-1.0-0")


class Open3DVoxels:
    """Triangles (T, 3, 3) in Open3D's memory, and the last voxel grid."""

    def __init__(self, corners_world: np.ndarray) -> None:
        self._open3d = import_open3d()
        self.name = f"Open3D {self._open3d.__version__}"
        utility = self._open3d.utility
        vertices = utility.Vector3dVector(np.ascontiguousarray(corners_world, np.float64).reshape(-1, 3))
        triangles = np.arange(3 * len(corners_world), dtype=np.int32).reshape(-1, 3)
        self._mesh = self._open3d.geometry.TriangleMesh(vertices, utility.Vector3iVector(triangles))
        self._voxels: Any = None

    def voxelize(self, voxel_size_world: float) -> None:
        """Create the grid with voxels of this side; call `clear` first, so that freeing the last one is not timed."""
        self._voxels = self._open3d.geometry.VoxelGrid.create_from_triangle_mesh(self._mesh, voxel_size_world)

    @property
    def voxel_count(self) -> int:
        """Number of voxels of the last grid, from its text: `get_voxels` would create a Python object for each."""
        return int(str(self._voxels).split()[2])

    def clear(self) -> None:
        """Free the last grid."""
        self._voxels = None


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds of both; raises PatchNetError without Open3D, GeometryError without a surface."""
    import_open3d()  # before reading a large scene
    corners_world = read_triangles(args.scene)
    mesh, theirs = TriangleMesh.from_arrays(corners_world), Open3DVoxels(corners_world)
    side_world = Grid.around(mesh.bounds_world, args.depth).voxel_size_world
    voxelized(mesh, _WARM_DEPTH)  # also compiles
    theirs.voxelize(Grid.around(mesh.bounds_world, _WARM_DEPTH).voxel_size_world)
    runs: dict[str, Callable[[], Any]] = {
        "ours": partial(voxelized, mesh, args.depth),
        "peer": partial(theirs.voxelize, side_world),
    }
    with limit_threads(args.threads):
        seconds, details = timed(runs, args.repeats, args.threads, prepare=theirs.clear)
        octree = voxelized(mesh, args.depth)
    details |= {
        "scene": args.scene.name if args.scene else SHELLS,
        "depth": args.depth,
        "triangles": len(corners_world),
        "ours_voxels": octree.leaf_count,
        "ours_nodes": octree.node_count,
        "peer_voxels": theirs.voxel_count,
        "peer_name": theirs.name,
    }
    ours, peer = seconds["ours"], seconds["peer"]
    return comparison("voxelize", ours, peer, details, "s", higher_is_better=False)
