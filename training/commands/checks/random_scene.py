# SPDX-License-Identifier: GPL-3.0-or-later
"""Maker of a random scene: the same seed gives the same scene in every process.

Parts have random streams of their own, so that a new kind of material leaves the shapes of all seeds as they were.
"""

from __future__ import annotations

from random import Random

import bpy

from ....operators.demo_scene.geometry import add_object
from .materials import new_material
from .placing import place, vary_visibility
from .shapes import new_ground, new_shape
from .surroundings import add_camera, add_lamps, add_world

_SIZES = (1e-3, 0.1, 20.0, 1e3)
_OFFSETS = (30.0, 1e3)


def build_random_scene(seed: int) -> None:
    """Replace what is open by the scene of a seed: one to four objects, a material or two, lamps, world and camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name, scene.render.engine = f"Seed {seed}", "CYCLES"
    stream = {name: Random(f"{name} {seed}") for name in ("shapes", "materials", "placing", "light", "camera", "whole")}
    rng = stream["materials"]
    materials = [new_material(rng, f"Material {number}") for number in range(1, rng.randint(2, 3))]
    new_ground(stream["shapes"], Random(f"ground {seed}"))
    for number in range(1, stream["shapes"].randint(1, 4) + 1):
        item = new_shape(stream["shapes"], number, materials)
        place(stream["placing"], item, number)
        vary_visibility(stream["placing"], item)
    add_world(stream["light"])
    add_lamps(stream["light"])
    add_camera(stream["camera"])
    _transform(stream["whole"])
    bpy.context.view_layer.update()


def _transform(rng: Random) -> None:
    """Scale or move the whole scene, sometimes, by a parent of all that has none."""
    size = rng.choice(_SIZES) if rng.random() < 0.12 else 1.0
    offset = rng.choice(_OFFSETS) * size if rng.random() < 0.08 else 0.0
    if size == 1.0 and not offset:
        return
    roots = [item for item in bpy.data.objects if item.parent is None]
    whole = add_object(bpy.context.scene.collection, "Whole", None)
    whole.scale, whole.location = (size,) * 3, (offset, 0.0, 0.0)
    for item in roots:
        item.parent = whole
    for data in bpy.data.lights:
        data.energy *= 1.0 if data.type == "SUN" else size**2
    for camera in bpy.data.cameras:
        camera.clip_start, camera.clip_end = camera.clip_start * size, camera.clip_end * size
        camera.ortho_scale *= size
