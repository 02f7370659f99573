# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxelizer benchmark: ours beside Open3D's `VoxelGrid.create_from_triangle_mesh` (https://www.open3d.org).

Open3D marks the voxels that a triangle meets, in one thread. Ours also clips the triangles, weighs and averages light
and normals, and builds the octree of all levels. Both get the triangles in memory and the same voxel size; light is
constant, so that no texture is read.
"""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from ...patchnet_addon.octree.build import build_octree
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.progress import drain
from ...patchnet_addon.runtime.threads import limit_threads
from ...patchnet_addon.surface.mesh import Fragments, TriangleBatch, TriangleMesh
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


def import_open3d() -> ModuleType:
    """Open3D, or a PatchNetError that says how to get it."""
    try:
        import open3d
    except (ImportError, OSError) as cause:
        raise PatchNetError(
            f"Open3D cannot be imported ({cause}): install patchnet-blender[peers], and on Debian libusb-1.0-0"
        ) from cause
    return open3d


class Open3DVoxels:
    """Triangles (T, 3, 3) in Open3D's memory, and the last voxel grid made of them."""

    def __init__(self, corners_world: np.ndarray, warm_world: float) -> None:
        """Run once with the large voxel side `warm_world`, as ours does."""
        self._open3d = import_open3d()
        utility = self._open3d.utility
        vertices = utility.Vector3dVector(np.ascontiguousarray(corners_world, np.float64).reshape(-1, 3))
        triangles = np.arange(3 * len(corners_world), dtype=np.int32).reshape(-1, 3)
        self._mesh = self._open3d.geometry.TriangleMesh(vertices, utility.Vector3iVector(triangles))
        self._voxels: Any = None
        self.voxelize(warm_world)

    @property
    def name(self) -> str:
        """Program and version."""
        return f"Open3D {self._open3d.__version__}"

    def voxelize(self, voxel_size_world: float) -> None:
        """Make the grid, with voxels of this side; `clear` before, so that freeing the last one is not timed."""
        self._voxels = self._open3d.geometry.VoxelGrid.create_from_triangle_mesh(self._mesh, voxel_size_world)

    @property
    def voxel_count(self) -> int:
        """Voxels of the last grid; its text says how many; `get_voxels` would make a Python object of each."""
        return int(str(self._voxels).split()[2])

    def clear(self) -> None:
        """Let the last grid go."""
        self._voxels = None


def benchmark_voxelize(
    corners_world: np.ndarray, depth: int, repeats: int = 3, *, threads: int = 1
) -> Comparison:
    """Time both on triangles (T, 3, 3) at 2^depth cells along the longest axis.

    One thread is bound to a core and measured in processor seconds, several in wall seconds; Open3D has one.
    Raises PatchNetError if Open3D cannot be imported, GeometryError if there is no surface.
    """
    ours = OurVoxels(corners_world)
    theirs = Open3DVoxels(corners_world, Grid.around(ours.mesh.bounds_world, WARM_DEPTH).voxel_size_world)
    grid = Grid.around(ours.mesh.bounds_world, depth)
    with limit_threads(threads):
        comparison = compare(
            "voxelize",
            lambda: ours.voxelize(grid),
            lambda: theirs.voxelize(grid.voxel_size_world),
            repeats,
            all_cores=threads > 1,
            prepare=theirs.clear,
        )
    assert ours.octree is not None
    details = comparison.details | {
        "depth": depth,
        "threads": threads,
        "triangles": len(corners_world),
        "ours_voxels": ours.octree.leaf_count,
        "ours_nodes": ours.octree.node_count,
        "ours_fragments": ours.fragments,
        "peer_voxels": theirs.voxel_count,
        "peer_name": theirs.name,
    }
    return replace(comparison, details=details)
