# SPDX-License-Identifier: GPL-3.0-or-later
"""Repair of meshes that were made for viewers with one-sided faces: each face once, neighbours turned the same way.

Such models have each face twice, turned round. Importers keep either, and what is left faces in and out at random: its
smooth normals are wrong, and the side that an opaque sheet shows is.
"""

from __future__ import annotations

import bmesh
import bpy
import numpy as np

_MOST_TURNED = 0.02  # of the edges between two faces
_SAME = 7  # decimals of the mesh's extent


def vertices_of(mesh: bpy.types.Mesh) -> np.ndarray:
    """Vertices (n, 3) float64 of a mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)


def repair_mesh(mesh: bpy.types.Mesh) -> None:
    """Remove faces that lie on others, and turn faces outwards where many neighbours disagree; a good mesh stays."""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    doubles = _doubles(shape, vertices_of(mesh))
    bmesh.ops.delete(shape, geom=doubles, context="FACES")
    turned = _turned_share(shape) > _MOST_TURNED
    if turned:
        bmesh.ops.recalc_face_normals(shape, faces=shape.faces[:])
    if doubles or turned:
        shape.to_mesh(mesh)
    shape.free()
    if turned and (normals := mesh.attributes.get("custom_normal")) is not None:
        mesh.attributes.remove(normals)


def _doubles(shape: bmesh.types.BMesh, points: np.ndarray) -> list[bmesh.types.BMFace]:
    """Faces whose corners are at the places of those of an earlier face."""
    places = np.round(points / max(np.ptp(points, axis=0).max(), 1e-30), _SAME)
    numbers = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    seen, doubles = set(), []
    for face in shape.faces:
        corners = frozenset(int(numbers[vertex.index]) for vertex in face.verts)
        if corners in seen:
            doubles.append(face)
        seen.add(corners)
    return doubles


def _turned_share(shape: bmesh.types.BMesh) -> float:
    """Share of the edges between two faces along which these are turned opposite ways."""
    shared = [edge for edge in shape.edges if len(edge.link_faces) == 2]
    return sum(not edge.is_contiguous for edge in shared) / max(len(shared), 1)
