# SPDX-License-Identifier: GPL-3.0-or-later
"""Random lamps, worlds and cameras."""

from __future__ import annotations

from math import cos, sin
from random import Random

import bpy
from mathutils import Vector

from ....operators.demo_scene.geometry import add_object

TARGET = (0.0, 0.0, 0.8)


def add_world(rng: Random) -> None:
    """Add a world: none, a colour, a gradient, or a sky."""
    kind = rng.choices(("none", "color", "gradient", "sky"), (2, 5, 2, 2))[0]
    if kind == "none":
        return
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    tree = world.node_tree
    background = tree.nodes["Background"]
    background.inputs["Color"].default_value = (*(rng.uniform(0.1, 0.9) for _ in range(3)), 1.0)
    background.inputs["Strength"].default_value = rng.uniform(0.3, 1.0)
    if kind == "gradient":
        ways, split, ramp = (tree.nodes.new(f"ShaderNode{each}") for each in ("TexCoord", "SeparateXYZ", "ValToRGB"))
        ramp.color_ramp.elements[0].color = (rng.random(), rng.random(), rng.random(), 1.0)
        tree.links.new(ways.outputs["Generated"], split.inputs[0])
        tree.links.new(split.outputs[rng.choice("XZ")], ramp.inputs[0])
        tree.links.new(ramp.outputs[0], background.inputs["Color"])
    elif kind == "sky":
        sky = tree.nodes.new("ShaderNodeTexSky")
        sky.sky_type, sky.sun_direction = "PREETHAM", (rng.uniform(-1, 1), rng.uniform(-1, 1), 0.8)
        background.inputs["Strength"].default_value = 0.1
        tree.links.new(sky.outputs[0], background.inputs["Color"])


def add_lamps(rng: Random) -> None:
    """Add one to three lamps, which shine on the origin; the first is mostly a sun."""
    for number in range(1, rng.choices((1, 2, 3), (4, 2, 1))[0] + 1):
        kind = rng.choices(("SUN", "POINT", "SPOT", "AREA"), (6 if number == 1 else 1, 2, 2, 2))[0]
        data = bpy.data.lights.new(f"{kind.title()} {number}", kind)
        data.energy = rng.uniform(1.0, 4.0) if kind == "SUN" else rng.uniform(300.0, 1000.0)
        data.color = [rng.uniform(0.5, 1.0) for _ in range(3)]
        data.use_shadow = rng.random() > 0.05
        if kind == "SUN":
            data.angle = rng.choice((0.0, 0.01, 0.2))
        elif kind == "AREA":
            data.shape, data.size, data.size_y = rng.choice(("SQUARE", "DISK", "RECTANGLE", "ELLIPSE")), 1.5, 0.5
        else:
            data.shadow_soft_size = rng.choice((0.0, 0.1, 0.4))
        item, angle = add_object(bpy.context.scene.collection, data.name, data), rng.uniform(0.0, 6.3)
        item.location = (3.0 * cos(angle), 3.0 * sin(angle), rng.uniform(3.0, 5.0))
        _aim(item, TARGET)


def _aim(item: bpy.types.Object, target: tuple[float, float, float]) -> None:
    item.rotation_euler = (Vector(target) - item.location).to_track_quat("-Z", "Y").to_euler()


def add_camera(rng: Random) -> None:
    """Add the active camera, which looks at the origin: perspective, orthographic, shifted, mirrored, with a parent."""
    data = bpy.data.cameras.new("Camera")
    item, angle = add_object(bpy.context.scene.collection, "Camera", data), rng.uniform(0.0, 6.3)
    item.location = (6.0 * cos(angle), 6.0 * sin(angle), rng.uniform(1.5, 5.0))
    bpy.context.scene.camera = item
    _aim(item, TARGET)
    data.lens = rng.uniform(32.0, 50.0)
    kind = rng.choices(("", "orthographic", "shifted", "mirrored", "parent"), (8, 2, 1, 1, 1))[0]
    if kind == "orthographic":
        data.type, data.ortho_scale = "ORTHO", 5.0
    elif kind == "shifted":
        data.shift_x, data.shift_y = 0.15, -0.1
    elif kind == "mirrored":
        item.scale = (-1.0, 1.0, 1.0)
    elif kind == "parent":
        parent = add_object(bpy.context.scene.collection, "Parent of Camera", None)
        parent.rotation_euler, parent.scale = (0.0, 0.0, 0.7), (1.0, 1.0, 0.8)
        item.parent = parent
