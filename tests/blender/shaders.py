# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials, images and worlds of a few nodes."""

from collections.abc import Callable

import bpy
import numpy as np

Maker = Callable[[bpy.types.NodeTree], bpy.types.NodeSocket]


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


def added(tree: bpy.types.NodeTree, *shaders: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """The sum of two shaders."""
    node = tree.nodes.new("ShaderNodeAddShader")
    for each, end in zip(shaders, node.inputs, strict=True):
        tree.links.new(each, end)
    return node.outputs[0]


def read_by(kind: str, output: str | int = "Color", **settings: object) -> Maker:
    """An output of a new node with these settings."""

    def socket(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        node = tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        return node.outputs[output]

    return socket


def glowing(color: Maker, name: str = "Glow") -> bpy.types.Material:
    """A material that emits what nodes yield."""
    result, tree = material(name)
    emission = shader(tree, "Emission")
    tree.links.new(color(tree), emission.node.inputs["Color"])
    shown(tree, emission)
    return result


def image(name: str, pixels: np.ndarray, *, float_buffer: bool = True, data: bool = False) -> bpy.types.Image:
    """An image of pixels (H, W, 4), row 0 at the bottom."""
    result = bpy.data.images.new(name, *pixels.shape[1::-1], alpha=True, float_buffer=float_buffer, is_data=data)
    result.pixels.foreach_set(pixels.astype(np.float32).ravel())
    result.update()
    return result


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
