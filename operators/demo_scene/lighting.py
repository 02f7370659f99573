# SPDX-License-Identifier: GPL-3.0-or-later
"""Sun and sky of the courtyard; the lamp is a mesh and hangs in the arcade (ironwork)."""

from __future__ import annotations

import bpy
from mathutils import Vector

from ..scene_access.blender_version import start_nodes
from .geometry import add_object
from .materials import linear

TO_SUN = (0.62, -0.66, 0.86)  # direction from the courtyard to the sun


def build_light(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Afternoon sun from the front right, and a sky that is blue above and sandy below the horizon."""
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle, sun.color = 3.6, 0.012, (1.0, 0.91, 0.78)
    item = add_object(collection, "Sun", sun)
    item.rotation_euler = Vector(TO_SUN).to_track_quat("Z", "Y").to_euler()
    item.location = Vector(TO_SUN) * 8.0
    scene.world = _sky()


def _sky() -> bpy.types.World:
    world = bpy.data.worlds.new("Sky")
    tree = start_nodes(world)
    nodes, links = tree.nodes, tree.links
    nodes.clear()
    place = nodes.new("ShaderNodeTexCoord")
    split = nodes.new("ShaderNodeSeparateXYZ")
    height = nodes.new("ShaderNodeMapRange")
    height.inputs["From Min"].default_value, height.inputs["From Max"].default_value = -1.0, 1.0
    ramp, background = nodes.new("ShaderNodeValToRGB"), nodes.new("ShaderNodeBackground")
    output = nodes.new("ShaderNodeOutputWorld")
    stops = [
        (0.0, (0.60, 0.56, 0.51)),
        (0.38, (0.76, 0.74, 0.71)),
        (0.5, (0.87, 0.88, 0.88)),
        (0.62, (0.66, 0.79, 0.91)),
        (1.0, (0.28, 0.49, 0.78)),
    ]
    ramp.color_ramp.elements.remove(ramp.color_ramp.elements[1])
    for number, (position, colour) in enumerate(stops):
        stop = ramp.color_ramp.elements[0] if number == 0 else ramp.color_ramp.elements.new(position)
        stop.position, stop.color = position, (*linear(colour), 1.0)
    background.inputs["Strength"].default_value = 0.9
    links.new(place.outputs["Generated"], split.inputs["Vector"])
    links.new(split.outputs["Z"], height.inputs["Value"])
    links.new(height.outputs["Result"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], background.inputs["Color"])
    links.new(background.outputs["Background"], output.inputs["Surface"])
    for number, node in enumerate((place, split, height, ramp, background, output)):
        node.location = (220 * number - 900, 0)
    return world
