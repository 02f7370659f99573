# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree of triangles in memory against Open3D's `VoxelGrid.create_from_triangle_mesh` (https://www.open3d.org).

Open3D marks the voxels that overlap a triangle, in one thread. PatchNet also clips the triangles, computes weighted
means of light and normals, and builds all levels of the octree. Both get the same triangles and voxel size.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ....patchnet_addon.octree.grid import Grid
from ....patchnet_addon.runtime.threads import limit_threads
from ....patchnet_addon.surface.mesh import TriangleMesh
from ...benchmarks.timing import comparison, timed
from .inputs import SHELLS, imported, read_triangles, voxelized

_WARM_DEPTH = 5


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds of both; raises PatchNetError without Open3D, GeometryError without a surface."""
    # Before reading a large scene.
    open3d = imported("Open3D", "open3d", "patchnet-blender[peers], and on Debian libusb-1.0-0")
    corners_world = read_triangles(args.scene)
    mesh = TriangleMesh.from_arrays(corners_world)
    vertices = open3d.utility.Vector3dVector(np.ascontiguousarray(corners_world, np.float64).reshape(-1, 3))
    triangles = np.arange(3 * len(corners_world), dtype=np.int32).reshape(-1, 3)
    theirs = open3d.geometry.TriangleMesh(vertices, open3d.utility.Vector3iVector(triangles))
    found: list[Any] = []  # their grid, which is freed before the next run, so that this is not timed

    def voxelize(depth: int) -> None:
        side_world = Grid.around(mesh.bounds_world, depth).voxel_size_world
        found.append(open3d.geometry.VoxelGrid.create_from_triangle_mesh(theirs, side_world))

    voxelized(mesh, _WARM_DEPTH)  # also compiles
    voxelize(_WARM_DEPTH)
    runs: dict[str, Callable[[], Any]] = {
        "ours": partial(voxelized, mesh, args.depth),
        "peer": partial(voxelize, args.depth),
    }
    with limit_threads(args.threads):
        seconds, details = timed(runs, args.repeats, args.threads, prepare=found.clear)
        octree = voxelized(mesh, args.depth)
    details |= {
        "scene": args.scene.name if args.scene else SHELLS,
        "depth": args.depth,
        "triangles": len(corners_world),
        "ours_voxels": octree.leaf_count,
        "ours_nodes": octree.node_count,
        # From its text: `get_voxels` would create a Python object for each.
        "peer_voxels": int(str(found[-1]).split()[2]),
        "peer_name": f"Open3D {open3d.__version__}",
    }
    ours, peer = seconds["ours"], seconds["peer"]
    return comparison("voxelize", ours, peer, details, "s", higher_is_better=False)
