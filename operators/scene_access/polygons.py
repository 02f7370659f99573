# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons of temporary meshes."""

from __future__ import annotations

import bpy
import numpy as np


def add_polygons(mesh: bpy.types.Mesh, corners: np.ndarray) -> None:
    """Fill an empty mesh with N separate polygons of K corners (N, K, 3); the caller updates it.

    Attributes take arrays a hundred times as fast as the properties of vertices and corners do.
    """
    count, sides = corners.shape[:2]
    if not count:  # a mesh without vertices has no attribute of their places
        return
    mesh.vertices.add(count * sides)
    mesh.loops.add(count * sides)
    mesh.polygons.add(count)
    mesh.attributes["position"].data.foreach_set("vector", corners.astype(np.float32, copy=False).ravel())
    mesh.attributes[".corner_vert"].data.foreach_set("value", np.arange(count * sides, dtype=np.int32))
    mesh.polygons.foreach_set("loop_start", np.arange(0, count * sides, sides, dtype=np.int32))
