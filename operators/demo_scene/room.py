# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed room of 2 m after the Cornell box: coloured walls, two boxes, a lamp, a luminous panel, a screen, bricks.

All surfaces are diffuse, so that Cycles and an octree can agree. The room has the cases in which they differ: corners,
contact shadows, colour bleeding, a sheet with differently lit sides, and a board thinner than a coarse voxel.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..computing.demo_textures import Colour
from ..computing.demo_textures import bricks as brick_wall
from .courtyard import FIELD_OF_VIEW
from .geometry import Shape, add_object, ball, box, place
from .materials import principled, to_image

SIDE = 2.0  # m
_RED, _GREEN, _WHITE = (0.80, 0.26, 0.22), (0.35, 0.66, 0.30), (0.88, 0.87, 0.85)


def build_glossy_room(scene: bpy.types.Scene, seed: int = 1) -> None:
    """Build the room with metals, a mirror and a pane of glass, which a bake of diffuse light alone shows black."""
    build_room(scene, seed)
    gold = principled("Gold", (1.0, 0.84, 0.50), roughness=0.3, inputs={"Metallic": 1.0})
    steel = principled("Steel", (0.80, 0.80, 0.82), roughness=0.4, inputs={"Metallic": 1.0})
    mirror = principled("Mirror", (0.98, 0.98, 0.98), roughness=0.0, inputs={"Metallic": 1.0})
    glass = principled("Glass", (1.0, 1.0, 1.0), roughness=0.0, inputs={"Transmission Weight": 1.0})
    collection = bpy.data.collections["Room"]
    place(collection, "Ball", ball(0.26, 32).moved((0.42, -0.30, 0.81)), gold, smooth=True)
    for item, material in (("Tall box", steel), ("Board", steel)):
        bpy.data.objects[item].data.materials[0] = material
    place(collection, "Mirror", box((-0.35, 0.97, 1.3), (0.35, 0.995, 1.8)), mirror)
    place(collection, "Pane", box((-0.85, -0.45, 0.0), (-0.15, -0.435, 0.9)), glass)


def build_room(scene: bpy.types.Scene, seed: int = 1) -> None:
    """Build the room with its camera into a scene; every random choice from `seed`."""
    collection = bpy.data.collections.new("Room")
    scene.collection.children.link(collection)
    white = _matt("White", _WHITE)
    bricks = to_image("Bricks", brick_wall(np.random.default_rng(seed), 512, 12, 5))
    walls = [white, _matt("Bricks", image=bricks), _matt("Red", _RED), _matt("Green", _GREEN)]
    _build_shell(collection, walls)
    tall = box((-0.27, -0.27, 0.0), (0.27, 0.27, 1.1)).turned(0.32).moved((-0.38, 0.35, 0.0))
    short = box((-0.27, -0.27, 0.0), (0.27, 0.27, 0.55)).turned(-0.30).moved((0.40, -0.30, 0.0))
    place(collection, "Tall box", tall, white)
    place(collection, "Short box", short, _matt("Blue", (0.45, 0.58, 0.80)))
    place(collection, "Board", box((0.93, -0.2, 0.9), (0.999, 0.6, 0.912)), white)
    screen = np.array([[[0.1, 0.62, z], [0.72, 0.86, z]] for z in (0.0, 0.8)])
    place(collection, "Screen", _sheet(screen), _matt("Ochre", (0.85, 0.66, 0.35)))
    lamp = principled("Panel", (1.0, 0.96, 0.88), specular=0.0, emission=0.8)
    place(collection, "Panel", box((-0.999, 0.0, 1.2), (-0.97, 0.5, 1.5)), lamp)
    _build_lamp(collection)
    _build_camera(scene, collection)
    scene.render.engine = "CYCLES"
    scene.view_settings.view_transform = "Standard"


def _matt(name: str, color: Colour | None = None, image: bpy.types.Image | None = None) -> bpy.types.Material:
    return principled(name, color, image, roughness=1.0, specular=0.0)


def _sheet(corners: np.ndarray) -> Shape:
    """Build a quad of corners (2, 2, 3), rows then columns; its normal is the column direction x the row direction."""
    return Shape(corners.reshape(-1, 3), [(0, 1, 3, 2)])


def _build_shell(collection: bpy.types.Collection, walls: list[bpy.types.Material]) -> None:
    """Six inward faces that close the room: bricks behind, red on the left, green on the right, else white."""
    half = SIDE / 2
    outside = box((-half, -half, 0.0), (half, half, SIDE))
    shell = Shape(outside.vertices, [face[::-1] for face in outside.faces])
    item = place(collection, "Room", shell, walls[0], repeat=0.9)
    for material in walls[1:]:
        item.data.materials.append(material)
    for polygon in item.data.polygons:
        x, y, _ = polygon.center
        polygon.material_index = 1 if y > 0.9 else 2 if x < -0.9 else 3 if x > 0.9 else 0


def _build_lamp(collection: bpy.types.Collection) -> None:
    """Square area light under the ceiling; it shines downwards only, as area lights do in Cycles."""
    data = bpy.data.lights.new("Lamp", "AREA")
    data.shape, data.size, data.energy = "SQUARE", 0.7, 30.0
    add_object(collection, "Lamp", data).location = (0.0, 0.0, SIDE - 0.02)


def _build_camera(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    data = bpy.data.cameras.new("Front")
    data.sensor_fit, data.angle, data.clip_start = "AUTO", 1.6 * FIELD_OF_VIEW, 0.001
    item = add_object(collection, "Front", data)
    item.location, item.rotation_euler = (0.0, -0.96, 1.0), (np.pi / 2, 0.0, 0.0)
    scene.camera = item
    scene.render.resolution_x = scene.render.resolution_y = 512
