# SPDX-License-Identifier: GPL-3.0-or-later
"""Random materials: node graphs of shaders, colours and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Any

import bpy

COLORS, VALUES, UVS = "Tint", "Weight", ("UVMap", "Other")
"""Attributes and UV maps that materials ask for by name, and objects may have."""
_IMAGES = ("COLOR_GRID", "UV_GRID")
_NUMBERS = (
    ("Metallic", 0.0, 1.0), ("Roughness", 0.0, 1.0), ("Diffuse Roughness", 0.0, 1.0), ("Subsurface Weight", 0.0, 0.5),
    ("Specular IOR Level", 0.0, 1.0), ("Transmission Weight", 0.0, 1.0), ("Coat Weight", 0.0, 1.0),
    ("Sheen Weight", 0.0, 1.0), ("Alpha", 0.0, 1.0), ("IOR", 1.1, 2.0),
)  # fmt: skip
_OUTPUTS = {
    "NewGeometry": ("Backfacing",), "LayerWeight": ("Facing", "Fresnel"),
    "LightPath": ("Is Camera Ray", "Is Shadow Ray", "Is Diffuse Ray"),
}  # fmt: skip


def plain_material(name: str, color: Sequence[float] = (0.5, 0.5, 0.5)) -> bpy.types.Material:
    """A new diffuse material."""
    material = bpy.data.materials.new(name)
    make_plain(material, color)
    return material


def make_plain(material: bpy.types.Material, color: Sequence[float] = (0.5, 0.5, 0.5)) -> None:
    """Replace the nodes of a material by a diffuse shader."""
    tree = _cleared(material)
    shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (*color, 1.0)
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])


def new_material(rng: Random, name: str) -> bpy.types.Material:
    """A new material of random nodes; sometimes plain, without nodes, or with other settings of transparency."""
    material = bpy.data.materials.new(name)
    material.diffuse_color = (rng.random(), rng.random(), rng.random(), 1.0)
    if rng.random() < 0.04:
        material.use_nodes = False
        return material
    tree = _cleared(material)
    graph = Graph(rng, tree)
    graph.feed(tree.nodes["Material Output"].inputs["Surface"], graph.shader(2))
    if rng.random() < 0.05:
        material.surface_render_method, material.use_backface_culling = "BLENDED", True
    return material


def _cleared(material: bpy.types.Material) -> bpy.types.NodeTree:
    """Node tree with an output alone."""
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    tree.nodes.new("ShaderNodeOutputMaterial").name = "Material Output"
    return tree


class Graph:
    """Random nodes in a tree; what methods return, a socket or a constant, goes to `feed`. depth: of nodes above."""

    def __init__(self, rng: Random, tree: bpy.types.NodeTree) -> None:
        self._rng, self._tree = rng, tree

    def feed(self, socket: bpy.types.NodeSocket, value: Any) -> None:
        """Link a socket to an input, or set the input's value."""
        if isinstance(value, bpy.types.NodeSocket):
            self._tree.links.new(value, socket)
        else:
            socket.default_value = value

    def _node(self, kind: str, **settings: Any) -> bpy.types.Node:
        node = self._tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        return node

    def shader(self, depth: int) -> Any:
        """A surface shader: mostly the Principled BSDF or one of its kind, above that mixed and added ones."""
        kinds: dict[str, float] = {
            "BsdfPrincipled": 6,
            "BsdfDiffuse": 4,
            "Emission": 1,
            "BsdfTransparent": 1,
            "BsdfTranslucent": 1,
        }
        kinds |= {"BsdfGlossy": 0.5, "SubsurfaceScattering": 0.3, "BsdfSheen": 0.3, "BsdfGlass": 0.3}
        kinds |= {"MixShader": 3, "AddShader": 0.7} if depth else {}
        kind = self._kind(kinds)
        node = self._node(kind)
        if kind == "BsdfPrincipled":
            self._principled(node)
        elif kind in ("MixShader", "AddShader"):
            for socket in node.inputs[-2:]:
                self.feed(socket, self.shader(depth - 1))
            if kind == "MixShader":
                self.feed(node.inputs[0], self.number(1))
        else:
            self.feed(node.inputs["Color"], self.color(1))
        return node.outputs[0]

    def _principled(self, node: bpy.types.Node) -> None:
        self.feed(node.inputs["Base Color"], self.color(2))
        node.inputs["Roughness"].default_value = 0.8
        for name, low, high in self._rng.sample(_NUMBERS, self._rng.choices((0, 1, 2), (3, 3, 1))[0]):
            value = self.number(1) if self._rng.random() < 0.3 else self._rng.uniform(low, high)
            self.feed(node.inputs[name], value)
        if self._rng.random() < 0.1:
            self.feed(node.inputs["Emission Color"], self.color(1))
            node.inputs["Emission Strength"].default_value = self._rng.uniform(0.2, 1.0)
        if self._rng.random() < 0.08:
            bump = self._node("Bump")
            self.feed(bump.inputs["Height"], self.number(1))
            self.feed(node.inputs["Normal"], bump.outputs[0])

    def color(self, depth: int) -> Any:
        """A colour: constant, of an image, texture or attribute, or computed from others."""
        kinds: dict[str, float] = {
            "constant": 5,
            "image": 2,
            "texture": 2,
            "attribute": 1,
            "object": 0.5,
            "geometry": 0.5,
        }
        kinds |= {"ramp": 1, "mix": 1, "adjusted": 1, "combined": 0.5} if depth > 1 else {}
        kind = self._kind(kinds) if depth else "constant"
        if kind == "constant":
            return (*(self._rng.uniform(0.05, 0.9) for _ in range(3)), 1.0)
        return getattr(self, f"_{kind}")(depth)

    def number(self, depth: int) -> Any:
        """A number from 0 to 1: constant, or of a node."""
        kinds = {"constant": 4, "image": 1, "texture": 1, "attribute": 0.7, "object": 0.4, "math": 0.7}
        kind = self._kind(kinds | {"NewGeometry": 0.7, "LayerWeight": 0.3, "LightPath": 0.3}) if depth else "constant"
        if kind == "constant":
            return self._rng.random()
        if kind == "math":
            node = self._node(
                "Math", operation=self._rng.choice(("ADD", "MULTIPLY", "SUBTRACT", "GREATER_THAN", "POWER"))
            )
            for socket in node.inputs[:2]:
                self.feed(socket, self.number(depth - 1))
            return node.outputs[0]
        node = self._node(kind) if kind in _OUTPUTS else getattr(self, f"_{kind}")(0).node
        names = _OUTPUTS.get(kind) or ("Alpha", "Fac", "Factor", "Random", "Distance")
        return self._rng.choice([output for output in node.outputs if output.name in names])

    def _kind(self, kinds: dict[str, float]) -> str:
        return self._rng.choices(tuple(kinds), tuple(kinds.values()))[0]

    def _coordinates(self, node: bpy.types.Node) -> None:
        """Coordinates of a texture: its default, a UV map by name, or others, scaled."""
        kind = self._rng.choice(("", "uv", "coordinates", "mapping"))
        if kind == "uv":
            self.feed(node.inputs["Vector"], self._node("UVMap", uv_map=self._rng.choice(UVS)).outputs[0])
        elif kind:
            source = self._node("TexCoord").outputs[self._rng.choice(("Generated", "Object", "UV", "Normal"))]
            if kind == "mapping":
                mapping = self._node("Mapping")
                mapping.inputs["Scale"].default_value = [self._rng.uniform(0.5, 2.0) for _ in range(3)]
                mapping.inputs["Rotation"].default_value = (0.0, 0.0, self._rng.uniform(0.0, 3.0))
                self.feed(mapping.inputs["Vector"], source)
                source = mapping.outputs[0]
            self.feed(node.inputs["Vector"], source)

    def _image(self, _: int) -> Any:
        """An image without alpha, or with, in each mode of alpha."""
        kind, clear = self._rng.choice(_IMAGES), self._rng.random() < 0.5
        name = f"{kind.title()}{' with Alpha' if clear else ''}"
        image = bpy.data.images.get(name) or _new_image(name, kind, clear)
        node = self._node("TexImage", image=image)
        image.alpha_mode = self._rng.choice(("STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"))
        node.interpolation = self._rng.choice(("Linear", "Closest", "Cubic"))
        node.extension = self._rng.choice(("REPEAT", "REPEAT", "EXTEND", "CLIP", "MIRROR"))
        node.projection = self._rng.choices(("FLAT", "BOX", "SPHERE", "TUBE"), (8, 1, 0.5, 0.5))[0]
        self._coordinates(node)
        return node.outputs["Color"]

    def _texture(self, _: int) -> Any:
        """A procedural texture of large features: fine ones cannot be told from noise in a small picture."""
        kind = self._rng.choice(
            ("TexChecker", "TexNoise", "TexVoronoi", "TexWave", "TexGradient", "TexBrick", "TexMagic")
        )
        node = self._node(kind)
        if "Scale" in node.inputs:
            node.inputs["Scale"].default_value = self._rng.uniform(0.8, 2.5)
        self._coordinates(node)
        return node.outputs["Color"]

    def _attribute(self, _: int) -> Any:
        name = self._rng.choice((COLORS, COLORS, VALUES, "Missing"))
        return self._node("Attribute", attribute_name=name).outputs["Color"]

    def _object(self, _: int) -> Any:
        return self._node("ObjectInfo").outputs["Color"]

    def _geometry(self, _: int) -> Any:
        return self._node("NewGeometry").outputs[self._rng.choice(("Normal", "Position", "True Normal"))]

    def _ramp(self, _: int) -> Any:
        node = self._node("ValToRGB")
        node.color_ramp.interpolation = self._rng.choice(("LINEAR", "CONSTANT", "EASE"))
        for element in node.color_ramp.elements:
            element.color = self.color(0)
        self.feed(node.inputs[0], self.number(1))
        return node.outputs[0]

    def _mix(self, depth: int) -> Any:
        node = self._node("Mix", data_type="RGBA", blend_type=self._rng.choice(("MIX", "MULTIPLY", "ADD", "OVERLAY")))
        self.feed(node.inputs[0], self.number(1))
        for socket in (node.inputs[6], node.inputs[7]):
            self.feed(socket, self.color(depth - 1))
        return node.outputs[2]

    def _adjusted(self, depth: int) -> Any:
        """A colour through a node that changes it."""
        kind, name, value = self._rng.choice(
            (
                ("Gamma", "Gamma", 1.8),
                ("Invert", "Fac", 0.8),
                ("HueSaturation", "Hue", 0.7),
                ("BrightContrast", "Bright", 0.1),
            )
        )
        node = self._node(kind)
        (node.inputs.get(name) or node.inputs[0]).default_value = value
        self.feed(node.inputs["Color"], self.color(depth - 1))
        return node.outputs[0]

    def _combined(self, depth: int) -> Any:
        node = self._node("CombineColor")
        for socket in node.inputs:
            self.feed(socket, self.number(depth - 1))
        return node.outputs[0]


def _new_image(name: str, kind: str, clear: bool) -> bpy.types.Image:
    """A generated image of 32 x 32 texels, packed, whose alpha falls from right to left with a hole, or is 1."""
    image = bpy.data.images.new(name, 32, 32, alpha=True)
    image.generated_type = kind
    if clear:
        pixels = list(image.pixels)
        for row in range(32):
            for column in range(32):
                hole = 8 <= row < 20 and 8 <= column < 20
                pixels[4 * (32 * row + column) + 3] = 0.0 if hole else (column + 1) / 32
        image.pixels = pixels
    image.pack()
    return image
