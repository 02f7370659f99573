# SPDX-License-Identifier: GPL-3.0-or-later
"""Open3D's `VoxelGrid.create_from_triangle_mesh` (https://www.open3d.org), the peer of the voxelizer.

It marks the voxels that a triangle meets, in one thread.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError

# Measured with Open3D 0.20 on a sphere of 1.2 M voxels: 84; its hash table doubles now and then.
BYTES_PER_VOXEL = 120


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
