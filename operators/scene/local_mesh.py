# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of evaluated Blender meshes."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import GeometryError
from ...patchnet_addon.surface.local_mesh import LocalMesh, packed_normals
from ..state.digest import ATTRIBUTE_KINDS, values_of, vertices_of_corners
from .images import srgb_to_linear
from .layer_names import DEFAULT_COLOR, GENERATED

_MOST_TURNED = 0.02  # of the triangles


@dataclass(frozen=True, eq=False)
class MeshToRead:
    """Evaluated mesh, or a copy of it, that is to be read.

    name, data_name: of the object and of the user's own data, for messages. layer_names: UV maps and colour attributes
    that materials read by name. origin: see `LocalMesh`.
    """

    mesh: bpy.types.Mesh
    name: str
    data_name: str
    layer_names: frozenset[str]
    origin: str


def read_local_mesh(wanted: MeshToRead) -> LocalMesh | None:
    """Arrays of a mesh, or None if it has no faces.

    No triangle is left if all are damaged. Raises GeometryError if vertices of faces do not exist.
    """
    mesh, name = wanted.mesh, wanted.name
    mesh.calc_loop_triangles()
    if not len(mesh.loop_triangles):
        return None
    loops = values_of(mesh.loop_triangles, "loops", 3, np.int32).reshape(-1, 3)
    vertices, corners = values_of(mesh.vertices, "co", 3, np.float32).reshape(-1, 3), vertices_of_corners(mesh)
    if corners.max() >= len(vertices):  # Cycles reads what lies behind them, and crashes
        raise GeometryError(
            f"The mesh of object '{name}' has faces without vertices, with which Cycles crashes: delete the object, or "
            f"repair it in the Python console by bpy.data.meshes['{wanted.data_name}'].validate()"
        )
    kept = np.ones(len(loops), bool)
    if not np.isfinite(vertices).all():  # Cycles leaves out triangles with these
        kept = np.isfinite(vertices).all(axis=1)[corners[loops]].all(axis=1)
        loops = loops[kept]
    vertices, triangles = _used(vertices, corners[loops])
    slots = _slots(mesh)
    if slots is not None and not kept.all():
        slots = slots[kept]
    uv_layer = next((layer for layer in mesh.uv_layers if layer.active_render), None)
    normals = _normals(mesh, loops, kept)
    return LocalMesh(
        name=name,
        vertices=vertices,
        triangles=triangles,
        uvs=_uvs(uv_layer)[loops] if uv_layer else None,
        slots=slots if slots is not None and slots.any() else None,
        normals=normals,
        layers={key: values[loops] for key in sorted(wanted.layer_names) if (values := _layer(mesh, key)) is not None},
        origin=wanted.origin,
        damaged=not kept.all(),
        turned="custom_normal" in mesh.attributes and normals is not None and _turned(vertices[triangles], normals),
    )


def _slots(mesh: bpy.types.Mesh) -> np.ndarray | None:
    """(T,) int16 slot of each triangle, None if all are the first; many times faster than from the triangles."""
    attribute = mesh.attributes.get("material_index")
    if attribute is None or (attribute.data_type, attribute.domain) != ("INT", "FACE"):  # Blender takes no others
        return None
    faces = values_of(mesh.loop_triangle_polygons, "value", 1, np.int32)
    return values_of(attribute.data, "value", 1, np.int32).astype(np.int16)[faces]


def _turned(corners: np.ndarray, normals: np.ndarray) -> bool:
    """Return whether more than _MOST_TURNED of the normals (T, 3, 3) point to the backs of triangles (T, 3, 3)."""
    fronts = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return bool(((normals.sum(axis=1, dtype=np.float32) * fronts).sum(axis=1) < 0.0).mean() > _MOST_TURNED)


def _used(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices without those that no triangle uses, and triangles (T, 3) that index them."""
    used = np.zeros(len(vertices), bool)
    used[triangles.ravel()] = True
    if used.all():
        return vertices, triangles
    renumbered = (np.cumsum(used) - 1).astype(np.int32)
    return vertices[used], renumbered[triangles]


def _uvs(layer: bpy.types.MeshUVLoopLayer) -> np.ndarray:
    """(L, 2) float32; Cycles has rules of its own for those that are not finite."""
    return values_of(layer.uv, "vector", 2, np.float32).reshape(-1, 2)


def _normals(mesh: bpy.types.Mesh, loops: np.ndarray, kept: np.ndarray) -> np.ndarray | None:
    """(T, 3, 3) int16 shading normals, or None if every face is flat; kept: of all triangles, those of `loops`."""
    if mesh.normals_domain == "FACE":
        return None
    normals = packed_normals(values_of(mesh.corner_normals, "vector", 3, np.float32).reshape(-1, 3))[loops]
    if mesh.normals_domain == "POINT" and "custom_normal" in mesh.attributes:  # flat faces stay flat in Cycles
        flat = ~values_of(mesh.loop_triangles, "use_smooth", 1, np.bool_)[kept]
        of_faces = values_of(mesh.loop_triangles, "normal", 3, np.float32).reshape(-1, 3)[kept]
        normals[flat] = packed_normals(of_faces[flat])[:, None]
    return normals


def _layer(mesh: bpy.types.Mesh, name: str) -> np.ndarray | None:
    """UV map (L, 2), colours (L, 4), vectors (L, 3) or numbers (L, 1), by name, at the corners."""
    if name == GENERATED:  # of the mesh before modifiers
        points = values_of(mesh.vertices, "undeformed_co", 3, np.float32).reshape(-1, 3)
        return generated_from_position(mesh, points)[vertices_of_corners(mesh)]
    if name in mesh.uv_layers:
        return _uvs(mesh.uv_layers[name])
    attribute = mesh.attributes.get(mesh.attributes.default_color_name if name == DEFAULT_COLOR else name)
    if attribute is None or attribute.data_type not in ATTRIBUTE_KINDS:
        return None
    key, width, dtype = ATTRIBUTE_KINDS[attribute.data_type]
    values = values_of(attribute.data, key, width, dtype).reshape(-1, width)
    if attribute.domain == "EDGE":
        values = _at_vertices(mesh, values, attribute)
    values = values.astype(np.float32)
    if attribute.domain in ("POINT", "EDGE"):
        return values[vertices_of_corners(mesh)]
    if attribute.domain == "FACE":
        return np.repeat(values, values_of(mesh.polygons, "loop_total", 1, np.int32), axis=0)
    return values if attribute.domain == "CORNER" else None


def _at_vertices(mesh: bpy.types.Mesh, values: np.ndarray, attribute: bpy.types.Attribute) -> np.ndarray:
    """Means (V, C) at vertices of an attribute's values (E, C) at edges, by Blender's rule for its type."""
    if attribute.data_type == "BYTE_COLOR":
        values = values_of(attribute.data, "color_srgb", 4, np.float32).reshape(-1, 4)
    ends = values_of(mesh.edges, "vertices", 2, np.int32).reshape(-1, 2)
    sums, counts = np.zeros((len(mesh.vertices), values.shape[1]), np.float32), np.zeros(len(mesh.vertices), np.float32)
    np.add.at(sums, ends, values[:, None])
    np.add.at(counts, ends, 1.0)
    means: np.ndarray = sums / np.maximum(counts, 1.0)[:, None]
    match attribute.data_type:
        case "BOOLEAN":
            return means > 0.0
        case "INT" | "INT8":
            return np.floor(means + np.float32(0.5))
        case "BYTE_COLOR":
            return np.concatenate([srgb_to_linear(means[:, :3]), means[:, 3:]], axis=1)
        case "QUATERNION":
            return means / np.maximum(np.linalg.norm(means, axis=1, keepdims=True), 1e-30)
    return means


def generated_from_position(mesh: bpy.types.Mesh, points: np.ndarray) -> np.ndarray:
    """Generated coordinates (N, 3) float32 of points (N, 3): [0, 1]^3 in a mesh's texture space."""
    size = np.array(mesh.texspace_size, np.float32)
    scale = np.where(size != 0, 0.5 / np.where(size != 0, size, 1.0), 0.0).astype(np.float32)
    return (points - np.array(mesh.texspace_location, np.float32)) * scale + np.float32(0.5)
