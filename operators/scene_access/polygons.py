# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons of temporary meshes."""

from __future__ import annotations

import bpy
import numpy as np


def add_polygons(mesh: bpy.types.Mesh, corners: np.ndarray) -> None:
    """Fill an empty mesh with N separate polygons of K corners (N, K, 3); the caller updates it."""
    count, sides = corners.shape[:2]
    mesh.vertices.add(count * sides)
    mesh.loops.add(count * sides)
    mesh.polygons.add(count)
    mesh.vertices.foreach_set("co", corners.astype(np.float32).ravel())
    mesh.loops.foreach_set("vertex_index", np.arange(count * sides, dtype=np.int32))
    mesh.polygons.foreach_set("loop_start", np.arange(0, count * sides, sides, dtype=np.int32))
