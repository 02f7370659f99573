# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry nodes that give each point of a mesh the shape of its voxel, as large as its attribute `side` says."""

from __future__ import annotations

import bpy

from ..scene_access.own import OWNER

SIDE = "side"
_CUBES = "PatchNet Voxels as Cubes"
_POINTS = "PatchNet Voxels as Points"


def cubes_group(material: bpy.types.Material) -> bpy.types.NodeTree:
    """Instances of a cube, which become one mesh unless Keep Instances is set; made once a file.

    As one mesh the viewport draws many voxels much faster than as instances, and shows their colour in solid mode too;
    instances take less memory.
    """
    return _own_group(_CUBES) or _new_cubes(material)


def points_group(material: bpy.types.Material) -> bpy.types.NodeTree:
    """Point cloud of spheres that fit into the voxels; made once a file."""
    return _own_group(_POINTS) or _new_points(material)


def _own_group(name: str) -> bpy.types.NodeTree | None:
    return next((item for item in bpy.data.node_groups if item.get(OWNER) == name), None)


def _new_cubes(material: bpy.types.Material) -> bpy.types.NodeTree:
    tree = _new_group(_CUBES)
    keep = tree.interface.new_socket("Keep Instances", in_out="INPUT", socket_type="NodeSocketBool")
    keep.description = "Leave the cubes instances: less memory, but a slower viewport, and no colors in Solid shading"
    given = tree.nodes.new("NodeGroupInput")
    cube = _node(tree, "GeometryNodeMeshCube", Size=(1.0, 1.0, 1.0))
    instances = _node(
        tree, "GeometryNodeInstanceOnPoints",
        Points=given.outputs["Geometry"],
        Instance=_coloured(tree, cube.outputs["Mesh"], material),
        Scale=_side(tree, given),
    )  # fmt: skip
    realized = _node(tree, "GeometryNodeRealizeInstances", Geometry=instances.outputs["Instances"])
    switch = tree.nodes.new("GeometryNodeSwitch")
    switch.input_type = "GEOMETRY"
    _connect(
        tree, switch,
        Switch=given.outputs["Keep Instances"],
        **{"False": _with_active_colour(tree, given, realized), "True": instances.outputs["Instances"]},
    )  # fmt: skip
    return _finished(tree, switch.outputs["Output"])


def _with_active_colour(
    tree: bpy.types.NodeTree, given: bpy.types.Node, realized: bpy.types.Node
) -> bpy.types.NodeSocket:
    """Cubes as a mesh that knows which attribute is its colour: solid mode shows nothing else.

    A joined mesh takes that from the first one, here a single vertex of the original, inside its own cube.
    """
    later = _node(tree, "FunctionNodeCompare", A=tree.nodes.new("GeometryNodeInputIndex").outputs[0], B=0.5)
    first = _node(
        tree, "GeometryNodeDeleteGeometry", Geometry=given.outputs["Geometry"], Selection=later.outputs["Result"]
    )
    joined = tree.nodes.new("GeometryNodeJoinGeometry")
    for node in (realized, first):  # the last link is the first mesh
        tree.links.new(node.outputs["Geometry"], joined.inputs["Geometry"])
    return joined.outputs["Geometry"]


def _new_points(material: bpy.types.Material) -> bpy.types.NodeTree:
    tree = _new_group(_POINTS)
    given = tree.nodes.new("NodeGroupInput")
    half = tree.nodes.new("ShaderNodeMath")
    half.operation, half.inputs[1].default_value = "MULTIPLY", 0.5
    tree.links.new(_side(tree, given), half.inputs[0])
    points = _node(tree, "GeometryNodeMeshToPoints", Mesh=given.outputs["Geometry"], Radius=half.outputs[0])
    return _finished(tree, _coloured(tree, points.outputs["Points"], material))


def _new_group(name: str) -> bpy.types.NodeTree:
    """Create a group from geometry to geometry with the input Size, a factor on all sides."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree[OWNER] = name
    tree.is_modifier = True
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    size = tree.interface.new_socket("Size", in_out="INPUT", socket_type="NodeSocketFloat")
    size.default_value, size.min_value, size.max_value = 1.0, 0.0, 1.0
    size.description = "Share of each voxel that is filled; less than 1 leaves gaps between them"
    return tree


def _finished(tree: bpy.types.NodeTree, geometry: bpy.types.NodeSocket) -> bpy.types.NodeTree:
    """Group with its output, and its nodes in columns by what they depend on."""
    tree.links.new(geometry, tree.nodes.new("NodeGroupOutput").inputs["Geometry"])
    for index, node in enumerate(tree.nodes):
        node.location = (220 * (index // 2), -220 * (index % 2))
    return tree


def _side(tree: bpy.types.NodeTree, given: bpy.types.Node) -> bpy.types.NodeSocket:
    """Voxel's side times Size."""
    attribute = _node(tree, "GeometryNodeInputNamedAttribute", Name=SIDE)  # of floats, as new nodes are
    product = tree.nodes.new("ShaderNodeMath")
    product.operation = "MULTIPLY"
    tree.links.new(attribute.outputs["Attribute"], product.inputs[0])
    tree.links.new(given.outputs["Size"], product.inputs[1])
    return product.outputs[0]


def _coloured(
    tree: bpy.types.NodeTree, geometry: bpy.types.NodeSocket, material: bpy.types.Material
) -> bpy.types.NodeSocket:
    return _node(tree, "GeometryNodeSetMaterial", Geometry=geometry, Material=material).outputs["Geometry"]


def _node(tree: bpy.types.NodeTree, kind: str, **inputs: object) -> bpy.types.Node:
    node = tree.nodes.new(kind)
    _connect(tree, node, **inputs)
    return node


def _connect(tree: bpy.types.NodeTree, node: bpy.types.Node, **inputs: object) -> None:
    """Sockets become links, other values defaults."""
    for name, value in inputs.items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, node.inputs[name])
        else:
            node.inputs[name].default_value = value
