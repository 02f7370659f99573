# SPDX-License-Identifier: GPL-3.0-or-later
"""Models of furniture libraries as meshes of the catalogue's size, upright, facing -y.

Meshes for viewers with one-sided faces have each face twice, in opposite orientations. Importers keep one of the two at
random, so smooth normals and visible sides of opaque sheets are wrong. These meshes are repaired.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from .library import LibraryFileError, Piece, keep_own_textures, opened_archive, unpack_folder

# Models of libraries have y up and face +z.
_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def library_meshes(pieces: Sequence[Piece]) -> dict[Piece, bpy.types.Mesh]:
    """Import the models of pieces of libraries, each once; raises LibraryFileError for a model without surface."""
    meshes: dict[Piece, bpy.types.Mesh] = {}
    for library in sorted({piece.library for piece in pieces if piece.library is not None}):
        with opened_archive(library) as archive, tempfile.TemporaryDirectory(prefix="patchnet-") as folder:
            for piece in pieces:
                if piece.library == library and piece not in meshes:
                    path = unpack_folder(archive, piece.model, Path(folder))
                    keep_own_textures(path.parent)
                    meshes[piece] = _imported(piece, path)
    return meshes


def fit_mesh(mesh: bpy.types.Mesh, size: tuple[float, float, float], turned: np.ndarray | None = None) -> None:
    """Rotate a mesh by `turned` (3, 3), scale its box to metres, and move the centre of its bottom to the origin."""
    points = vertices_of(mesh)
    turn = np.eye(3) if turned is None else turned
    points = points @ turn.T
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    scale = np.where(extent > 1e-9, size / np.maximum(extent, 1e-9), 1.0)  # a flat model stays flat
    middle = low + extent * (0.5, 0.5, 0.0)
    matrix = np.eye(4)
    matrix[:3, :3] = scale[:, None] * turn
    matrix[:3, 3] = -middle * scale
    mesh.transform(Matrix(matrix.tolist()))
    if np.linalg.det(turn) < 0:
        mesh.flip_normals()
    mesh.update()


def _imported(piece: Piece, path: Path) -> bpy.types.Mesh:
    """Import a file as one mesh without an object; its other data is removed."""
    before = set(bpy.data.objects)
    try:
        bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z", use_split_objects=False)
    except RuntimeError as cause:
        raise _damaged(piece) from cause
    found = [item for item in bpy.data.objects if item not in before]
    meshes = [item.data for item in found if item.type == "MESH" and item.data.polygons]
    for item in found:
        bpy.data.objects.remove(item)
    if len(meshes) != 1:
        raise _damaged(piece)
    mesh = meshes[0]
    points = vertices_of(mesh)
    if not np.isfinite(points).all() or not np.ptp(points, axis=0).any():
        raise _damaged(piece)
    for material in mesh.materials:
        nodes = [] if material is None else material.node_tree.nodes
        for node in [node for node in nodes if node.type == "TEX_IMAGE"]:
            if node.image is not None and node.image.size[0]:
                node.image.pack()
            else:  # it cannot be read
                nodes.remove(node)
    repair_mesh(mesh)
    fit_mesh(mesh, piece.size, _Z_UP @ np.array(piece.rotation).reshape(3, 3))
    mesh.name = piece.name
    return mesh


def _damaged(piece: Piece) -> LibraryFileError:
    return LibraryFileError(
        f"Furniture library {piece.library} has no surface in {piece.model!r}, the model of {piece.name!r}: fetch it "
        "again, or choose another --seed"
    )


_MOST_TURNED = 0.02  # share of the edges between two faces
_SAME = 7  # decimals of the mesh's extent


def vertices_of(mesh: bpy.types.Mesh) -> np.ndarray:
    """Vertices (n, 3) float64 of a mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)


def repair_mesh(mesh: bpy.types.Mesh) -> None:
    """Remove duplicate faces; make normals consistent if many neighbours differ. A good mesh is unchanged."""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    doubles = _doubles(shape, vertices_of(mesh))
    bmesh.ops.delete(shape, geom=doubles, context="FACES")
    shared = [edge for edge in shape.edges if len(edge.link_faces) == 2]
    opposite = sum(not edge.is_contiguous for edge in shared)  # edges between two faces that turn against each other
    turned = opposite / max(len(shared), 1) > _MOST_TURNED
    if turned:
        bmesh.ops.recalc_face_normals(shape, faces=shape.faces[:])
    if doubles or turned:
        shape.to_mesh(mesh)
    shape.free()
    if turned and (normals := mesh.attributes.get("custom_normal")) is not None:
        mesh.attributes.remove(normals)


def _doubles(shape: bmesh.types.BMesh, points: np.ndarray) -> list[bmesh.types.BMFace]:
    """Faces with the same corner positions as an earlier face."""
    places = np.round(points / max(np.ptp(points, axis=0).max(), 1e-30), _SAME)
    numbers = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    seen, doubles = set(), []
    for face in shape.faces:
        corners = frozenset(int(numbers[vertex.index]) for vertex in face.verts)
        if corners in seen:
            doubles.append(face)
        seen.add(corners)
    return doubles
