# SPDX-License-Identifier: GPL-3.0-or-later
"""Object data that materials read, stored as mesh attributes when triangles of many objects are joined.

In copies of the materials, links from nodes that read the object (`asked_by`), and from generated and object
coordinates, lead to Attribute nodes. Layers have names of ours there, since a mesh has some of its own, such as "id".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy

from ...scene.instance_values import asked_by
from ...scene.layer_names import GENERATED, all_nodes, layer_of, name_layer, needs_generated, own_name
from ...scene_access.blender_version import tree_in_use

OBJECT = own_name("object")
_KINDS = {"RGBA": "Color", "VECTOR": "Vector", "VALUE": "Fac"}  # type of a socket -> output of the Attribute node
# Outputs by node type that joining changes, or that depend on the view; None: all outputs.
_LOST: dict[str, frozenset[str] | None] = {
    "TEX_COORD": frozenset({"Normal", "Camera", "Window", "Reflection"}),
    "NEW_GEOMETRY": frozenset({"Incoming", "Parametric", "Pointiness", "Random Per Island", "Tangent"}),
    "LIGHT_PATH": frozenset({"Ray Length"}),
    "BEVEL": None,
    "CAMERA": None,
    "FRESNEL": None,
    "LAYER_WEIGHT": None,
    "BSDF_HAIR": None,
    "BSDF_HAIR_PRINCIPLED": None,
    "BSDF_RAY_PORTAL": None,
    "HAIR_INFO": None,
    "POINT_INFO": None,
    "WIREFRAME": None,
}


def needs_coordinates(materials: Sequence[bpy.types.Material]) -> bool:
    """Return whether materials read object coordinates, which `redirect` takes from the attribute OBJECT."""
    return any(_own_coordinates(node) and node.outputs["Object"].is_linked for node in _nodes(materials))


def lost_inputs(material: bpy.types.Material, turned: bool = True) -> tuple[str, ...]:
    """Names of nodes in a material whose values the bake cannot reproduce.

    turned: the material is on objects that are turned or scaled.
    """
    names = []
    for node in _nodes([material]):
        linked = {socket.name for socket in node.outputs if socket.is_linked}
        outputs = _LOST.get(node.type, frozenset())
        if linked and (outputs is None or linked & outputs or _asks_whole_object(node, turned)):
            names.append(node.name)
    return tuple(dict.fromkeys(names))


def _asks_whole_object(node: bpy.types.Node, turned: bool) -> bool:
    """Return whether a node depends on its object, its instancer or the surface around, by its settings."""
    match node.type:
        case "AMBIENT_OCCLUSION":
            return node.inside or node.only_local
        case "TEX_IMAGE":
            return turned and node.projection == "BOX"
        case "NORMAL_MAP":
            return turned and node.space in ("OBJECT", "BLENDER_OBJECT")
        case "TANGENT":
            return node.direction_type == "RADIAL"
        case "SUBSURFACE_SCATTERING" | "BSDF_PRINCIPLED":
            return _scatters(node)
        case "VECT_TRANSFORM":
            spaces = {node.convert_from, node.convert_to}
            of_object = "OBJECT" in spaces and (turned or node.vector_type == "POINT")
            return len(spaces) == 2 and ("CAMERA" in spaces or of_object)
    return False


def needs_redirect(tree: bpy.types.NodeTree) -> bool:
    """Return whether `redirect` changes anything in a tree or in a group of it."""
    return any(
        node.type == "NEW_GEOMETRY" or _own_coordinates(node) or _scatters(node) or needs_generated(node)
        or layer_of(node) or any(asked_by(node, socket.name) for socket in node.outputs)
        for node in all_nodes(tree)
    )  # fmt: skip


def redirect(tree: bpy.types.NodeTree, material_index: int, back: bool) -> None:
    """Replace links of a tree from object data by links from attributes; groups in it are left to the caller.

    back: the mesh shows its back sides as fronts, so that "Backfacing" is a constant 1. Light that scatters below the
    surface needs the whole object: it is baked as diffuse light.
    """
    for node in list(tree.nodes):
        if _scatters(node):
            _make_diffuse(tree, node)
        for socket in node.outputs:
            if asked := asked_by(node, socket.name):
                kind = socket.name if node.type == "ATTRIBUTE" else _KINDS[socket.type]
                _replace(tree, socket, asked.layer, kind)
        if _own_coordinates(node):
            _replace(tree, node.outputs["Generated"], GENERATED, "Vector")
            _replace(tree, node.outputs["Object"], OBJECT, "Vector")
        elif node.type == "OBJECT_INFO":
            _replace_constant(tree, node.outputs["Material Index"], float(material_index))
        elif layer := layer_of(node):
            name_layer(node, own_name(layer))
        elif needs_generated(node):
            tree.links.new(_attribute(tree, GENERATED).outputs["Vector"], node.inputs["Vector"])
        if node.type == "NEW_GEOMETRY" and back:
            _replace_constant(tree, node.outputs["Backfacing"], 1.0)


def _scatters(node: bpy.types.Node) -> bool:
    """Return whether light scatters below the surface of a shader."""
    weight = node.inputs.get("Subsurface Weight") if node.type == "BSDF_PRINCIPLED" else None
    return node.type == "SUBSURFACE_SCATTERING" or (
        weight is not None and (weight.is_linked or weight.default_value > 0.0)
    )


def _make_diffuse(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    if node.type == "BSDF_PRINCIPLED":
        weight = node.inputs["Subsurface Weight"]
        for link in list(weight.links):
            tree.links.remove(link)
        weight.default_value = 0.0
        return
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    for name in ("Color", "Normal"):
        for link in node.inputs[name].links:
            tree.links.new(link.from_socket, diffuse.inputs[name])
    diffuse.inputs["Color"].default_value = node.inputs["Color"].default_value
    _move_links(tree, node.outputs[0], diffuse.outputs[0])


def _own_coordinates(node: bpy.types.Node) -> bool:
    """Texture coordinates of the object that is shaded, neither of another one nor of what instances it."""
    return node.type == "TEX_COORD" and node.object is None and not node.from_instancer


def _nodes(materials: Sequence[bpy.types.Material]) -> Iterator[bpy.types.Node]:
    for material in materials:
        tree = tree_in_use(material)
        if tree is not None:
            yield from all_nodes(tree)


def _attribute(tree: bpy.types.NodeTree, name: str) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = own_name(name)
    return node


def _replace(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, attribute: str, output: str) -> None:
    if socket.is_linked:
        node = _attribute(tree, attribute)
        _move_links(tree, socket, node.outputs.get(output) or node.outputs["Factor"])  # "Fac" before Blender 5


def _replace_constant(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: float) -> None:
    if socket.is_linked:
        node = tree.nodes.new("ShaderNodeValue")
        node.outputs[0].default_value = value
        _move_links(tree, socket, node.outputs[0])


def _move_links(tree: bpy.types.NodeTree, old: bpy.types.NodeSocket, new: bpy.types.NodeSocket) -> None:
    for target in [link.to_socket for link in old.links]:
        tree.links.new(new, target)
