# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials and worlds of a few nodes."""

import bpy


def material(name: str = "Grey") -> tuple[bpy.types.Material, bpy.types.NodeTree]:
    """A material with an output node only, and its node tree."""
    result = bpy.data.materials.new(name)
    if result.node_tree is None:
        result.use_nodes = True
    result.node_tree.nodes.clear()
    result.node_tree.nodes.new("ShaderNodeOutputMaterial")
    return result, result.node_tree


def shader(tree: bpy.types.NodeTree, kind: str, **inputs: object) -> bpy.types.NodeSocket:
    """The output of a new shader node, e.g. "BsdfDiffuse"; inputs: values by name, with _ for spaces."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return node.outputs[0]


def shown(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> None:
    """Connect a shader to the material's output."""
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(socket, output.inputs["Surface"])


def mixed(
    tree: bpy.types.NodeTree, first: bpy.types.NodeSocket, second: bpy.types.NodeSocket, factor: float
) -> bpy.types.NodeSocket:
    """A mix shader."""
    node = tree.nodes.new("ShaderNodeMixShader")
    node.inputs[0].default_value = factor
    tree.links.new(first, node.inputs[1])
    tree.links.new(second, node.inputs[2])
    return node.outputs[0]


def simple(kind: str = "BsdfDiffuse", name: str = "Grey", **inputs: object) -> bpy.types.Material:
    """A material of one shader."""
    result, tree = material(name)
    shown(tree, shader(tree, kind, **inputs))
    return result


def grey(value: float = 0.5) -> bpy.types.Material:
    """A diffuse material."""
    return simple(Color=(value, value, value, 1.0))


def world() -> bpy.types.NodeTree:
    """The node tree of a new world: a background connected to the output."""
    result = bpy.data.worlds.new("World")
    if result.node_tree is None:
        result.use_nodes = True
    tree = result.node_tree
    tree.nodes.clear()
    background = tree.nodes.new("ShaderNodeBackground")
    tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs["Surface"])
    result.cycles.sampling_method, result.cycles.sample_map_resolution = "MANUAL", 256  # the default map takes a second
    bpy.context.scene.world = result
    return tree
