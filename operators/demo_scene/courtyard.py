# SPDX-License-Identifier: GPL-3.0-or-later
"""Courtyard: its parts, sun and sky, cameras at the distances that look-ahead needs, and its file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ..computing.demo_textures import courtyard_pictures
from ..scene.images import srgb_to_linear
from ..scene_access.blender_version import start_nodes
from . import furniture, ironwork, masonry, plants
from .geometry import add_object
from .materials import make_materials

FIELD_OF_VIEW = float(np.radians(50.0))
# Name: (position, target) in metres. Far and Middle have the distances that look-ahead needs at 192 pixels.
VIEWS = {
    "Far": ((3.4, -15.4, 7.3), (0.1, 0.4, 2.35)),
    "Middle": ((1.6, -10.85, 3.6), (-0.4, 0.6, 1.95)),
    "Close": ((0.15, -5.3, 2.0), (-1.6, -0.6, 1.0)),
}
TO_SUN = (0.62, -0.66, 0.86)  # direction from the courtyard to the sun


def streams(seed: int = 1) -> list[np.random.Generator]:
    """Random numbers of the textures, which come first, and of the courtyard's parts."""
    return np.random.default_rng(seed).spawn(8)


def build_courtyard(scene: bpy.types.Scene, seed: int = 1, pictures: Mapping[str, np.ndarray] | None = None) -> None:
    """Build the courtyard into a scene: about 12 m wide, every random choice from `seed`.

    pictures: textures by `courtyard_pictures`; computed here if None.

    A coarse view gets these wrong: fence, gate and grilles thinner than a distant pixel, a white cloth 7 mm above a
    dark table, and leaves cut by alpha. Sets the scene's world, camera and render settings.
    """
    numbers = iter(streams(seed)[1:])
    materials = make_materials(pictures or courtyard_pictures(streams(seed)[0]))
    names = ("Masonry", "Ironwork", "Furniture", "Plants", "Light", "Cameras")
    stone, iron, furnishing, green, light, cameras = (bpy.data.collections.new(name) for name in names)
    for part in (stone, iron, furnishing, green, light, cameras):
        scene.collection.children.link(part)
    masonry.build_floor(stone, materials, next(numbers))
    masonry.build_steps(stone, materials)
    masonry.build_walls(stone, materials)
    masonry.build_arcade(stone, materials)
    masonry.build_roofs(stone, materials, next(numbers))
    ironwork.build_fence(iron, materials)
    ironwork.build_gate(iron, materials)
    ironwork.build_grilles(iron, materials)
    ironwork.build_lantern(iron, materials)
    furniture.build_table(furnishing, materials, next(numbers))
    furniture.build_fountain(furnishing, materials, 2.1, -0.55)
    furniture.build_door(furnishing, materials)
    furniture.build_sign(furnishing, materials)
    plants.build_pots(green, materials, next(numbers))
    plants.build_tree(green, materials, next(numbers), 4.05, -1.3)
    plants.build_bougainvillea(green, materials, next(numbers))
    build_light(scene, light)
    build_cameras(scene, cameras)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 64, True
    scene.view_settings.view_transform = "Standard"
    scene.unit_settings.system = "METRIC"


def save_demo_scene(path: Path, seed: int = 1) -> None:
    """Build the courtyard in an empty file and save it with its images packed; replaces the open file."""
    bpy.ops.wm.read_homefile(use_empty=True)
    build_courtyard(bpy.context.scene, seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), compress=True)


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
        (0.0, (0.60, 0.56, 0.51)), (0.38, (0.76, 0.74, 0.71)), (0.5, (0.87, 0.88, 0.88)), (0.62, (0.66, 0.79, 0.91)),
        (1.0, (0.28, 0.49, 0.78)),
    ]  # fmt: skip
    ramp.color_ramp.elements.remove(ramp.color_ramp.elements[1])
    for number, (position, colour) in enumerate(stops):
        stop = ramp.color_ramp.elements[0] if number == 0 else ramp.color_ramp.elements.new(position)
        stop.position, stop.color = position, (*srgb_to_linear(np.array(colour)), 1.0)
    background.inputs["Strength"].default_value = 0.9
    links.new(place.outputs["Generated"], split.inputs["Vector"])
    links.new(split.outputs["Z"], height.inputs["Value"])
    links.new(height.outputs["Result"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], background.inputs["Color"])
    links.new(background.outputs["Background"], output.inputs["Surface"])
    for number, node in enumerate((place, split, height, ramp, background, output)):
        node.location = (220 * number - 900, 0)
    return world


def build_cameras(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Add the views for square pictures; Middle becomes the scene's camera."""
    for name, (position, target) in VIEWS.items():
        data = bpy.data.cameras.new(name)
        data.sensor_fit, data.angle = "AUTO", FIELD_OF_VIEW
        item = add_object(collection, name, data)
        item.location = position
        item.rotation_euler = (Vector(position) - Vector(target)).to_track_quat("Z", "Y").to_euler()
        if name == "Middle":
            scene.camera = item
    render = scene.render
    render.resolution_x = render.resolution_y = 512
    render.resolution_percentage = 100
