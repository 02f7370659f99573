# SPDX-License-Identifier: GPL-3.0-or-later
"""Object data that materials read, kept as mesh attributes when triangles of many objects are joined.

In copies of the materials, links from Object Info and from generated and object coordinates are led to Attribute nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy
import numpy as np

from ...scene.layer_names import GENERATED, all_nodes, needs_generated
from ...scene.scene_mesh import Run
from ...scene_access.blender_version import tree_in_use

OBJECT = "patchnet_object"
_INFO = {  # output of Object Info -> attribute
    "Location": "patchnet_location",
    "Color": "patchnet_color",
    "Alpha": "patchnet_alpha",
    "Object Index": "patchnet_object_index",
    "Random": "patchnet_random",
}
# Outputs by node type that joining changes, or that depend on the view; None means all of them.
_LOST: dict[str, frozenset[str] | None] = {
    "TEX_COORD": frozenset({"Normal", "Camera", "Window", "Reflection"}),
    "NEW_GEOMETRY": frozenset({"Incoming", "Parametric", "Pointiness", "Random Per Island"}),
    "LIGHT_PATH": frozenset({"Ray Length"}),
    "BEVEL": None,
    "CAMERA": None,
    "FRESNEL": None,
    "LAYER_WEIGHT": None,
    "PARTICLE_INFO": None,
    "HAIR_INFO": None,
    "POINT_INFO": None,
    "WIREFRAME": None,
}


def attributes_needed(materials: Sequence[bpy.types.Material]) -> frozenset[str]:
    """Names of attributes, GENERATED apart, that `redirect` will link to in copies of these materials."""
    needed: set[str] = set()
    for node in _nodes(materials):
        if node.type == "OBJECT_INFO":
            needed.update(_INFO[socket.name] for socket in node.outputs if socket.is_linked and socket.name in _INFO)
        elif _own_coordinates(node) and node.outputs["Object"].is_linked:
            needed.add(OBJECT)
    return frozenset(needed)


def lost_inputs(material: bpy.types.Material, turned: bool = True, divided: bool = True) -> tuple[str, ...]:
    """Names of nodes in a material whose values the bake cannot reproduce.

    turned: the material is on objects that are turned or scaled. divided: not all of the surface is baked at once.
    """
    names = []
    for node in _nodes([material]):
        outputs = _LOST.get(node.type, frozenset())
        linked = [socket.name for socket in node.outputs if socket.is_linked]
        if any(outputs is None or name in outputs for name in linked) or (
            linked and _asks_whole_object(node, turned, divided)
        ):
            names.append(node.name)
    return tuple(dict.fromkeys(names))


def _asks_whole_object(node: bpy.types.Node, turned: bool, divided: bool) -> bool:
    """Return whether a node's settings make it depend on its object, its instancer or the surface around."""
    match node.type:
        case "ATTRIBUTE":
            return node.attribute_type in ("OBJECT", "INSTANCER")
        case "TEX_COORD" | "UVMAP":
            return node.from_instancer
        case "AMBIENT_OCCLUSION":
            return node.inside or node.only_local
        case "TEX_IMAGE":
            return turned and node.projection == "BOX"
        case "NORMAL_MAP":
            return turned and node.space in ("OBJECT", "BLENDER_OBJECT")
        case "SUBSURFACE_SCATTERING":
            return divided
        case "BSDF_PRINCIPLED":
            weight = node.inputs["Subsurface Weight"]
            return divided and (weight.is_linked or weight.default_value > 0.0)
        case "VECT_TRANSFORM":
            spaces = {node.convert_from, node.convert_to}
            of_object = "OBJECT" in spaces and (turned or node.vector_type == "POINT")
            return len(spaces) == 2 and ("CAMERA" in spaces or of_object)
    return False


def attribute_values(run: Run, name: str) -> np.ndarray:
    """Values (N, 3, C) float32 of one of `attributes_needed` for the triangles of a run."""
    instances, part = run.instances, slice(run.lo, run.hi)
    if name == OBJECT:
        mesh = instances.mesh
        return run.per_corner(mesh.vertices[mesh.triangles])
    values = {
        "patchnet_location": instances.matrices_world[part, :3, 3],
        "patchnet_color": instances.colors[part],
        "patchnet_alpha": instances.colors[part, 3:],
        "patchnet_object_index": instances.indices[part, None],
        "patchnet_random": instances.random[part, None],
    }[name].astype(np.float32)  # (P, C)
    triangles = run.last - run.first
    return np.repeat(np.repeat(values, triangles, axis=0)[:, None], 3, axis=1)


def needs_redirect(material: bpy.types.Material) -> bool:
    """Return whether `redirect` changes anything in a material."""
    return any(
        node.type in ("OBJECT_INFO", "NEW_GEOMETRY") or _own_coordinates(node) or needs_generated(node)
        for node in _nodes([material])
    )


def redirect(tree: bpy.types.NodeTree, material_index: int, back: bool) -> None:
    """Lead links of a tree that ask the object to attributes; groups in it are left to the caller.

    back: the mesh shows its back sides as fronts, so that "Backfacing" is a constant 1.
    """
    for node in list(tree.nodes):
        if _own_coordinates(node):
            _replace(tree, node.outputs["Generated"], GENERATED, "Vector")
            _replace(tree, node.outputs["Object"], OBJECT, "Vector")
        elif node.type == "OBJECT_INFO":
            for name, attribute in _INFO.items():
                kind = {"Location": "Vector", "Color": "Color"}.get(name, "Fac")
                _replace(tree, node.outputs[name], attribute, kind)
            _replace_constant(tree, node.outputs["Material Index"], float(material_index))
        elif node.type == "NEW_GEOMETRY" and back:
            _replace_constant(tree, node.outputs["Backfacing"], 1.0)
        elif needs_generated(node):
            tree.links.new(_attribute(tree, GENERATED).outputs["Vector"], node.inputs["Vector"])


def _own_coordinates(node: bpy.types.Node) -> bool:
    """Texture coordinates of the object that is shaded, not of another one."""
    return node.type == "TEX_COORD" and node.object is None


def _nodes(materials: Sequence[bpy.types.Material]) -> Iterator[bpy.types.Node]:
    for material in materials:
        tree = tree_in_use(material)
        if tree is not None:
            yield from all_nodes(tree)


def _attribute(tree: bpy.types.NodeTree, name: str) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = name
    return node


def _replace(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, attribute: str, output: str) -> None:
    if socket.is_linked:
        node = _attribute(tree, attribute)
        # Blender 5 says "Factor" where it said "Fac".
        source = node.outputs.get(output) or node.outputs["Factor"]
        _move_links(tree, socket, source)


def _replace_constant(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: float) -> None:
    if socket.is_linked:
        node = tree.nodes.new("ShaderNodeValue")
        node.outputs[0].default_value = value
        _move_links(tree, socket, node.outputs[0])


def _move_links(tree: bpy.types.NodeTree, old: bpy.types.NodeSocket, new: bpy.types.NodeSocket) -> None:
    for target in [link.to_socket for link in old.links]:
        tree.links.new(new, target)
