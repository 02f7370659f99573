# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of the courtyard: Principled BSDFs with a plain colour, an image, or an image times a colour."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import bpy
import numpy as np

from ..computing.demo_textures import LEAVES, Colour
from ..scene.images import srgb_to_linear
from ..scene_access.blender_version import start_nodes


def principled(
    name: str,
    colour: Colour | None = None,
    image: bpy.types.Image | None = None,
    alpha: bool = False,
    roughness: float = 0.9,
    specular: float = 0.15,
    emission: float = 0.0,
    inputs: Mapping[str, float] = MappingProxyType({}),
) -> bpy.types.Material:
    """Material of an sRGB colour, an image, or both multiplied; `alpha` cuts by the image; inputs: shader values."""
    material = bpy.data.materials.new(name)
    tree = start_nodes(material)
    nodes, links = tree.nodes, tree.links
    nodes.clear()
    shader, output = nodes.new("ShaderNodeBsdfPrincipled"), nodes.new("ShaderNodeOutputMaterial")
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    shader.location, output.location = (0, 0), (300, 0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Specular IOR Level"].default_value = specular
    for key, value in inputs.items():
        shader.inputs[key].default_value = value
    rgba = (*srgb_to_linear(np.asarray(colour or (1.0, 1.0, 1.0))), 1.0)
    shader.inputs["Base Color"].default_value = rgba
    material.diffuse_color = rgba
    if emission:
        shader.inputs["Emission Color"].default_value = rgba
        shader.inputs["Emission Strength"].default_value = emission
    if image is not None:
        _link_image(material, shader, image, rgba if colour is not None else None, alpha)
    return material


def _link_image(
    material: bpy.types.Material,
    shader: bpy.types.Node,
    image: bpy.types.Image,
    tint: tuple[float, ...] | None,
    alpha: bool,
) -> None:
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture = nodes.new("ShaderNodeTexImage")
    texture.image, texture.location = image, (-600, 0)
    colour = texture.outputs["Color"]
    if tint is not None:
        mix = nodes.new("ShaderNodeMix")
        mix.data_type, mix.blend_type, mix.location = "RGBA", "MULTIPLY", (-300, 0)
        factor, first, second = (socket for socket in mix.inputs if socket.enabled)
        factor.default_value, second.default_value = 1.0, tint
        links.new(colour, first)
        colour = next(socket for socket in mix.outputs if socket.enabled)
    links.new(colour, shader.inputs["Base Color"])
    if alpha:
        links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])


def to_image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """Packed 8 bit image of pixels (height, width, 3 or 4) in [0, 1], first row at the bottom."""
    height, width, channels = pixels.shape
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :channels] = np.clip(pixels, 0, 1)
    image = bpy.data.images.new(name, width, height, alpha=channels == 4)
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image.pack()
    return image


def make_materials(pictures: Mapping[str, np.ndarray]) -> dict[str, bpy.types.Material]:
    """All materials of the courtyard by a short name."""
    images = {name: to_image(name, pixels) for name, pixels in pictures.items()}
    plaster, brick, stone, grain, glaze, linen, *_ = images.values()
    leaves = {name.removeprefix(LEAVES): image for name, image in images.items() if name.startswith(LEAVES)}
    made = {
        "plaster": principled("Plaster", image=plaster),
        "ochre": principled("Ochre plaster", (0.98, 0.80, 0.56), plaster),
        "brick": principled("Bricks", image=brick),
        "stone": principled("Stone", image=stone),
        "glaze": principled("Glazed tiles", image=glaze, roughness=0.6),
        "cloth": principled("Linen", image=linen),
        "table": principled("Dark walnut", (0.30, 0.20, 0.15), grain, roughness=0.7),
        "oak": principled("Oak", (0.72, 0.53, 0.36), grain),
        "door": principled("Blue paint", (0.22, 0.45, 0.58), grain),
        "iron": principled("Wrought iron", (0.13, 0.13, 0.14), roughness=0.7),
        "steel": principled("Galvanised steel", (0.62, 0.64, 0.64), roughness=0.6),
        "gold": principled("Gilding", (0.93, 0.76, 0.36), roughness=0.6),
        "sign": principled("Sign green", (0.12, 0.27, 0.22)),
        "dark": principled("Dark room", (0.16, 0.14, 0.13)),
        "clay": principled("Clay pot", (0.76, 0.44, 0.30)),
        "soil": principled("Soil", (0.24, 0.18, 0.14)),
        "bark": principled("Bark", (0.42, 0.34, 0.27)),
        "glass": principled("Bottle", (0.13, 0.25, 0.16), roughness=0.4),
        "white": principled("Porcelain", (0.93, 0.93, 0.91), roughness=0.5),
        "lemon": principled("Lemon", (0.95, 0.80, 0.20)),
        "orange": principled("Orange", (0.93, 0.52, 0.12)),
        "water": principled("Water", (0.28, 0.45, 0.48), roughness=0.3),
        "lamp": principled("Lamp glass", (1.0, 0.78, 0.47), emission=110.0),
    }
    for number, colour in enumerate([(0.80, 0.58, 0.44), (0.74, 0.50, 0.37), (0.84, 0.66, 0.51), (0.86, 0.74, 0.60)]):
        made[f"floor{number}"] = principled(f"Floor tile {number + 1}", colour)
    for number, colour in enumerate([(0.76, 0.45, 0.31), (0.69, 0.38, 0.26), (0.82, 0.55, 0.40)]):
        made[f"roof{number}"] = principled(f"Roof tile {number + 1}", colour)
    return made | {key: principled(f"{LEAVES}{key}", image=image, alpha=True) for key, image in leaves.items()}
