# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygon shapes as arrays, Blender objects of them, and instances; lengths in metres, z up."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import bpy
import numpy as np


@dataclass
class Shape:
    """Polygon mesh: vertices (n, 3), faces as vertex numbers, optional UV (n, 2) per vertex."""

    vertices: np.ndarray
    faces: list[tuple[int, ...]]
    uv: np.ndarray | None = None

    def moved(self, offset: Sequence[float]) -> Shape:
        """Shift the shape by `offset` (3,)."""
        return Shape(self.vertices + np.asarray(offset, float), self.faces, self.uv)

    def turned(self, angle: float, axis: int = 2) -> Shape:
        """Turn the shape about a main axis through the origin by `angle` radians."""
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        vertices = self.vertices.copy()
        vertices[:, i] = np.cos(angle) * self.vertices[:, i] - np.sin(angle) * self.vertices[:, j]
        vertices[:, j] = np.sin(angle) * self.vertices[:, i] + np.cos(angle) * self.vertices[:, j]
        return Shape(vertices, self.faces, self.uv)

    def repeated(self, u: float, v: float) -> Shape:
        """Repeat the shape's texture `u` and `v` times."""
        return Shape(self.vertices, self.faces, None if self.uv is None else self.uv * (u, v))


def join(shapes: Iterable[Shape]) -> Shape:
    """Join all shapes in one; UVs survive if every shape has them."""
    parts = list(shapes)
    faces: list[tuple[int, ...]] = []
    start = 0
    for part in parts:
        faces += [tuple(start + corner for corner in face) for face in part.faces]
        start += len(part.vertices)
    coordinates = [part.uv for part in parts if part.uv is not None]
    uv = np.concatenate(coordinates) if len(coordinates) == len(parts) else None
    return Shape(np.concatenate([part.vertices for part in parts]), faces, uv)


def box(low: Sequence[float], high: Sequence[float], bottom: bool = True) -> Shape:
    """Axis-aligned box between two corners, with or without its bottom face."""
    ends = np.array([low, high], float)
    corners = np.array([[ends[k >> 2 & 1, 0], ends[k >> 1 & 1, 1], ends[k & 1, 2]] for k in range(8)])  # (8, 3)
    faces: list[tuple[int, ...]] = [(1, 5, 7, 3), (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6)]
    return Shape(corners, faces + [(0, 2, 6, 4)] if bottom else faces)


def sheet(points: np.ndarray, closed: bool = False) -> Shape:
    """Quads over a grid of points (rows, columns, 3), UV over the unit square; `closed` joins last and first column."""
    rows, columns = points.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    nearby = np.roll(number, -1, axis=1) if closed else number[:, 1:]
    here = number if closed else number[:, :-1]
    quads = np.stack([here[:-1], nearby[:-1], nearby[1:], here[1:]], axis=-1).reshape(-1, 4)
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    return Shape(points.reshape(-1, 3), [tuple(quad) for quad in quads.tolist()], np.stack([u, v], -1).reshape(-1, 2))


def lathe(profile: Sequence[tuple[float, float]], segments: int = 24) -> Shape:
    """Revolve a profile of (radius, height) about z; faces point outwards if it runs from bottom to top."""
    angles = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(segments)], -1)  # (segments, 3)
    points = np.array([ring * radius + (0.0, 0.0, height) for radius, height in profile])
    return sheet(points, closed=True)


def tube(path: np.ndarray, radius: float | np.ndarray, sides: int = 6) -> Shape:
    """Round bar with closed ends along a path (n, 3); the radius may change along it (n,)."""
    path = np.asarray(path, float)
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    helper = np.eye(3)[np.argmin(np.abs(along).max(axis=0))]  # the main axis farthest from all directions of the path
    across = np.cross(along, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(along, across)
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    around = np.cos(angles)[None, :, None] * across[:, None] + np.sin(angles)[None, :, None] * other[:, None]
    shape = sheet(path[:, None] + around * np.broadcast_to(radius, len(path))[:, None, None], closed=True)
    count = len(path) * sides
    shape.faces += [tuple(range(sides))[::-1], tuple(range(count - sides, count))]
    return shape


def ball(radius: float, segments: int = 12) -> Shape:
    """Sphere of latitude rings about the origin."""
    angles = np.linspace(-np.pi / 2 + 0.05, np.pi / 2 - 0.05, segments // 2 + 2)
    return lathe([(radius * np.cos(angle), radius * np.sin(angle)) for angle in angles], segments)


def projected_uv(shape: Shape, repeat: float) -> np.ndarray:
    """UV (corners, 2) of every face corner: box projection, one texture repeat per `repeat` metres."""
    flat = []
    for face in shape.faces:
        points = shape.vertices[list(face)]
        normal = np.abs(np.cross(points[1] - points[0], points[2] - points[0]))
        # Rounding, which differs between machines, must not decide for faces at 45 degrees: the first axis counts.
        axes = ([1, 2], [0, 2], [0, 1])[int(np.argmax(normal > (1.0 - 1e-6) * normal.max()))]
        flat.append(points[:, axes] / repeat)
    return np.concatenate(flat)


def place(
    collection: bpy.types.Collection,
    name: str,
    shape: Shape,
    material: bpy.types.Material,
    smooth: bool = False,
    repeat: float = 1.0,
) -> bpy.types.Object:
    """Mesh object of a shape in a collection; shapes without UV get box projection with `repeat` metres."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(shape.vertices.tolist(), [], shape.faces)
    corners = np.fromiter((corner for face in shape.faces for corner in face), np.int64)
    uv = projected_uv(shape, repeat) if shape.uv is None else shape.uv[corners]
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uv.astype(np.float32).ravel())
    mesh.polygons.foreach_set("use_smooth", np.full(len(shape.faces), smooth))
    mesh.materials.append(material)
    mesh.update()
    return add_object(collection, name, mesh)


def add_object(collection: bpy.types.Collection, name: str, data: bpy.types.ID | None) -> bpy.types.Object:
    """Object with the given data (None: an empty) in a collection."""
    item = bpy.data.objects.new(name, data)
    collection.objects.link(item)
    return item


def bevel(item: bpy.types.Object, width: float, segments: int = 2) -> None:
    """Round the edges of an object."""
    modifier = item.modifiers.new("Bevel", "BEVEL")
    modifier.width, modifier.segments, modifier.limit_method = width, segments, "ANGLE"


def array(item: bpy.types.Object, count: int, step: Sequence[float]) -> None:
    """Repeat an object `count` times, `step` apart."""
    modifier = item.modifiers.new("Array", "ARRAY")
    modifier.count, modifier.use_relative_offset, modifier.use_constant_offset = count, False, True
    modifier.constant_offset_displace = step


def solidify(item: bpy.types.Object, thickness: float, rim_only: bool = False) -> None:
    """Thicken a sheet inwards; `rim_only` leaves out the other side, for sheets where it cannot be seen."""
    modifier = item.modifiers.new("Solidify", "SOLIDIFY")
    modifier.thickness, modifier.offset = thickness, -1.0
    modifier.use_rim_only = rim_only


def curve(
    collection: bpy.types.Collection,
    name: str,
    paths: Iterable[np.ndarray],
    radius: float,
    material: bpy.types.Material,
    resolution: int = 1,
) -> bpy.types.Object:
    """Curve object of round bars along paths (n, 3)."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions, data.bevel_depth, data.bevel_resolution = "3D", radius, resolution
    data.use_fill_caps = True
    for path in paths:
        spline = data.splines.new("POLY")
        spline.points.add(len(path) - 1)
        spline.points.foreach_set("co", np.column_stack([path, np.ones(len(path))]).astype(np.float32).ravel())
        spline.use_smooth = True
    data.materials.append(material)
    return add_object(collection, name, data)


def scatter(
    collection: bpy.types.Collection,
    name: str,
    prototype: bpy.types.Object,
    points: np.ndarray,
    rotations: np.ndarray,
) -> bpy.types.Object:
    """Object that instances `prototype` at points (n, 3) with Euler angles (n, 3)."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(points, float).tolist(), [], [])
    attribute = mesh.attributes.new("rotation", "FLOAT_VECTOR", "POINT")
    attribute.data.foreach_set("vector", np.asarray(rotations, np.float32).ravel())
    item = add_object(collection, name, mesh)
    item.modifiers.new("Instances", "NODES").node_group = _instance_nodes(name, prototype)
    return item


def _instance_nodes(name: str, prototype: bpy.types.Object) -> bpy.types.NodeTree:
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    source, output = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    instances, info = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = prototype
    info.inputs["As Instance"].default_value = True
    tree.links.new(source.outputs[0], instances.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], instances.inputs["Instance"])
    attribute = tree.nodes.new("GeometryNodeInputNamedAttribute")
    attribute.data_type = "FLOAT_VECTOR"
    attribute.inputs["Name"].default_value = "rotation"
    value = next(socket for socket in attribute.outputs if socket.enabled and socket.name == "Attribute")
    tree.links.new(value, instances.inputs["Rotation"])
    tree.links.new(instances.outputs["Instances"], output.inputs[0])
    return tree


def show_collection(
    parent: bpy.types.Collection,
    shown: bpy.types.Collection,
    location: Sequence[float],
    angle: float = 0.0,
    scale: float = 1.0,
) -> bpy.types.Object:
    """Empty that instances a collection, turned about z, scaled and moved."""
    item = add_object(parent, shown.name, None)
    item.instance_type, item.instance_collection = "COLLECTION", shown
    item.location, item.rotation_euler, item.scale = location, (0.0, 0.0, angle), (scale, scale, scale)
    return item
