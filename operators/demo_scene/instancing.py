# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances: geometry nodes that set an object on points, and empties that show a collection."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from .geometry import add_object


def scatter(
    collection: bpy.types.Collection,
    name: str,
    prototype: bpy.types.Object,
    points: np.ndarray,
    rotations: np.ndarray,
    scales: np.ndarray | None = None,
) -> bpy.types.Object:
    """Object that shows `prototype` at points (n, 3) with Euler angles (n, 3) and scales (n, 3)."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(points, float).tolist(), [], [])
    values = {"rotation": rotations, "scale": np.ones((len(points), 3)) if scales is None else scales}
    for key, array in values.items():
        attribute = mesh.attributes.new(key, "FLOAT_VECTOR", "POINT")
        attribute.data.foreach_set("vector", np.asarray(array, np.float32).ravel())
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
    for key in ("rotation", "scale"):
        attribute = tree.nodes.new("GeometryNodeInputNamedAttribute")
        attribute.data_type = "FLOAT_VECTOR"
        attribute.inputs["Name"].default_value = key
        value = next(socket for socket in attribute.outputs if socket.enabled and socket.name == "Attribute")
        tree.links.new(value, instances.inputs[key.capitalize()])
    tree.links.new(instances.outputs["Instances"], output.inputs[0])
    return tree


def show_collection(
    parent: bpy.types.Collection,
    shown: bpy.types.Collection,
    location: Sequence[float],
    angle: float = 0.0,
    scale: float = 1.0,
) -> bpy.types.Object:
    """Empty that shows a collection turned about z, scaled, and set to a place."""
    item = add_object(parent, shown.name, None)
    item.instance_type, item.instance_collection = "COLLECTION", shown
    item.location, item.rotation_euler, item.scale = location, (0.0, 0.0, angle), (scale, scale, scale)
    return item
