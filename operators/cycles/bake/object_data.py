# SPDX-License-Identifier: GPL-3.0-or-later
"""Object data that materials read, kept as mesh attributes when triangles of many objects are joined.

In copies of the materials, links from nodes that ask the object (`asked_by`), from generated and object coordinates and
from tangents around an axis are led to Attribute nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy
import numpy as np

from ...scene.instance_values import asked_by
from ...scene.layer_names import (
    DEFAULT_COLOR,
    GENERATED,
    all_nodes,
    asks_default_color,
    asks_tangent,
    needs_generated,
)
from ...scene.scene_mesh import Run
from ...scene_access.blender_version import tree_in_use

OBJECT = "patchnet_object"
_AROUND = {axis: f"patchnet_around_{axis}" for axis in "XYZ"}
_BY_ANGLE = ("LAYER_WEIGHT", "FRESNEL")
_KINDS = {"RGBA": "Color", "VECTOR": "Vector", "VALUE": "Fac"}  # type of a socket -> output of the Attribute node
# Outputs by node type that joining changes, or that depend on the view; None means all of them.
_LOST: dict[str, frozenset[str] | None] = {
    "TEX_COORD": frozenset({"Normal", "Camera", "Window", "Reflection"}),
    "NEW_GEOMETRY": frozenset({"Incoming", "Parametric", "Pointiness", "Random Per Island"}),
    "LIGHT_PATH": frozenset({"Ray Length"}),
    "BEVEL": None,
    "CAMERA": None,
    "FRESNEL": None,
    "LAYER_WEIGHT": None,
    "HAIR_INFO": None,
    "POINT_INFO": None,
    "WIREFRAME": None,
}


def attributes_needed(materials: Sequence[bpy.types.Material]) -> frozenset[str]:
    """Names of attributes that pages compute because `redirect` links to them in copies of these materials."""
    nodes = list(_nodes(materials))
    objects = {OBJECT for node in nodes if _own_coordinates(node) and node.outputs["Object"].is_linked}
    return frozenset(objects | {_around_of(node) for node in nodes if asks_tangent(node)})


def lost_inputs(material: bpy.types.Material, turned: bool = True, divided: bool = True) -> tuple[str, ...]:
    """Names of nodes in a material whose values the bake cannot reproduce.

    turned: the material is on objects that are turned or scaled. divided: not all of the surface is baked at once.
    """
    names = []
    for node in _nodes([material]):
        linked = {socket.name for socket in node.outputs if socket.is_linked}
        outputs = _LOST.get(node.type, frozenset())
        if linked and (outputs is None or linked & outputs or _asks_whole_object(node, turned, divided)):
            names.append(node.name)
    return tuple(dict.fromkeys(names))


def _asks_whole_object(node: bpy.types.Node, turned: bool, divided: bool) -> bool:
    """Return whether a node's settings make it depend on its object, its instancer or the surface around."""
    match node.type:
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
    mesh = run.instances.mesh
    if name == OBJECT:
        return run.per_corner(mesh.vertices[mesh.triangles])
    return _around(run, name[-1])


def placed_values(run: Run) -> dict[str, np.ndarray]:
    """Values (N, 3, C) float32, by layer, that the triangles of a run have from where they are placed."""
    count = run.last - run.first
    return {
        layer: np.repeat(np.repeat(values[run.lo : run.hi], count, axis=0)[:, None], 3, axis=1)
        for layer, values in run.instances.values.items()
    }


def _around(run: Run, axis: str) -> np.ndarray:
    """Directions (N, 3, 3) around an axis of the generated coordinates, in the world, as Cycles' tangents begin."""
    layer = run.instances.mesh.layers.get(GENERATED)
    if layer is None:
        return np.zeros((len(run), 3, 3), np.float32)
    around = np.cross(np.eye(3)["XYZ".index(axis)] * (-1.0 if axis == "Y" else 1.0), run.per_corner(layer) - 0.5)
    linear = run.instances.matrices_world[run.lo : run.hi, :3, :3]
    turned = np.einsum("pij,ptcj->ptci", _normal_transforms(linear), around.reshape(len(linear), -1, 3, 3))
    return turned.reshape(-1, 3, 3).astype(np.float32)


def _normal_transforms(linear: np.ndarray) -> np.ndarray:
    """Transposed inverses (P, 3, 3) of transforms; zero where there is none."""
    there = np.abs(np.linalg.det(linear)) > 0.0
    result = np.zeros_like(linear)
    result[there] = np.linalg.inv(linear[there]).transpose(0, 2, 1)
    return result


def needs_redirect(material: bpy.types.Material) -> bool:
    """Return whether `redirect` changes anything in a material."""
    return any(
        node.type in ("NEW_GEOMETRY", *_BY_ANGLE) or _own_coordinates(node) or needs_generated(node)
        or asks_default_color(node) or any(asked_by(node, socket.name) for socket in node.outputs)
        for node in _nodes([material])
    )  # fmt: skip


def redirect(tree: bpy.types.NodeTree, material_index: int, back: bool, oblique: bool = False) -> None:
    """Lead links of a tree that ask the object to attributes; groups in it are left to the caller.

    back: the mesh shows its back sides as fronts, so that "Backfacing" is a constant 1. oblique: nodes that depend on
    the angle of view see it as large as in the mean of all views, whose cosine is 2/3, and not from above.
    """
    for node in list(tree.nodes):
        for socket in node.outputs:
            if asked := asked_by(node, socket.name):
                kind = socket.name if node.type == "ATTRIBUTE" else _KINDS[socket.type]
                _replace(tree, socket, asked.layer, kind)
        if _own_coordinates(node):
            _replace(tree, node.outputs["Generated"], GENERATED, "Vector")
            _replace(tree, node.outputs["Object"], OBJECT, "Vector")
        elif node.type == "OBJECT_INFO":
            _replace_constant(tree, node.outputs["Material Index"], float(material_index))
        elif asks_default_color(node):
            node.layer_name = DEFAULT_COLOR
        elif asks_tangent(node):
            _make_tangent(tree, node)
        elif needs_generated(node):
            tree.links.new(_attribute(tree, GENERATED).outputs["Vector"], node.inputs["Vector"])
        if oblique and node.type in _BY_ANGLE and not node.inputs["Normal"].is_linked:
            tree.links.new(_oblique_normal(tree), node.inputs["Normal"])
        if node.type == "NEW_GEOMETRY" and back:
            _replace_constant(tree, node.outputs["Backfacing"], 1.0)


def _around_of(node: bpy.types.Node) -> str:
    """Attribute that the tangent of a node begins with; one without an axis takes Z."""
    return _AROUND[getattr(node, "axis", "Z")]


def _make_tangent(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Compute the tangent of a node from its attribute a and the normal n, as Cycles does: n x (a x n), unit length."""
    normal = tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
    across = _vector_math(tree, "CROSS_PRODUCT", _attribute(tree, _around_of(node)).outputs["Vector"], normal)
    value = _vector_math(tree, "CROSS_PRODUCT", normal, _vector_math(tree, "NORMALIZE", across))
    _move_links(tree, node.outputs["Tangent"], value)


def _oblique_normal(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Direction whose cosine to the normal is 2/3: the normal and 1.118 times a unit vector across it."""
    normal = tree.nodes.new("ShaderNodeNewGeometry").outputs["Normal"]
    across = _vector_math(tree, "NORMALIZE", _vector_math(tree, "CROSS_PRODUCT", normal, (0.48, 0.6, 0.64)))
    both = _vector_math(tree, "MULTIPLY_ADD", across, (1.118,) * 3, normal)
    return _vector_math(tree, "NORMALIZE", both)


def _vector_math(
    tree: bpy.types.NodeTree, operation: str, *inputs: bpy.types.NodeSocket | tuple[float, ...]
) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for value, target in zip(inputs, node.inputs, strict=False):
        if isinstance(value, tuple):
            target.default_value = value
        else:
            tree.links.new(value, target)
    return node.outputs[0]


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
    node.attribute_name = name
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
