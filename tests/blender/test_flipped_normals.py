# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces whose normals point the wrong way, and those of which both sides are seen, against Cycles."""

import math
from collections.abc import Callable

import bpy
import numpy as np
import pytest

from patchnet.tests.blender import objects, shaders
from patchnet.tests.blender.light_scene import bake, bake_surfels, checked, mean_ratios, picture
from patchnet.tests.blender.objects import CUBE_FACES, corners, link, look_from, mesh
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import simple

Place = tuple[float, float, float]
INWARD = [tuple(reversed(face)) for face in CUBE_FACES]


def start(world: float = 0.05) -> None:
    """Nothing but a gray world, as strong as Blender's own."""
    bpy.ops.wm.read_homefile(use_empty=True)
    shaders.world().nodes["Background"].inputs["Color"].default_value = (world, world, world, 1.0)


def add(name: str, places: list[Place], faces: list[tuple[int, ...]]) -> bpy.types.Object:
    paint = bpy.data.materials.get("Gray") or simple("BsdfPrincipled", "Gray", Base_Color=(0.6, 0.6, 0.6, 1.0))
    return link(mesh(name, places, faces, paint))


def square(name: str, half: float, z: float, down: bool = False) -> None:
    face = (3, 2, 1, 0) if down else (0, 1, 2, 3)
    add(name, [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)], [face])


def lamp(kind: str, place: Place, energy: float) -> None:
    objects.lamp(kind, energy, place).name = "Lamp"


def camera(place: Place, target: Place) -> None:
    data = look_from(place, target, "Camera").data
    data.lens, data.clip_start = 20.0, 0.01


def room(inward: bool, *, closed: bool, lit: bool = True, world: float = 0.05) -> None:
    """A room seen from inside, of six walls that are objects of their own or of one closed mesh, with a table."""
    start(world)
    places, faces = corners((-2, -2, 0), (2, 2, 2.5)), INWARD if inward else CUBE_FACES
    if closed:
        add("Walls", places, faces)
    else:
        for number, face in enumerate(faces):
            add(f"Wall {number}", [places[corner] for corner in face], [(0, 1, 2, 3)])
    add("Table", corners((-0.5, 0.3, 0.01), (0.5, 1, 0.7)), CUBE_FACES)
    if lit:
        lamp("POINT", (0, 0, 2.2), 50.0)
    camera((0, -1.8, 1.4), (0, 1, 1))


def sheet(down: bool, ground_down: bool = False) -> None:
    """A sheet in the sun above the ground, seen from above."""
    start()
    square("Ground", 3.0, 0.0, ground_down)
    square("Sheet", 1.0, 0.6, down)
    lamp("SUN", (1, -1, 5), 3.0)
    camera((1.5, -2.5, 2.6), (0, 0, 0.4))


def grid(flipped: Callable[[int], bool]) -> None:
    """A grid of 8 x 8 squares in the sun, some of whose columns point down, with a block on it."""
    start()
    places = [(-1 + i / 4, -1 + j / 4, 0.0) for j in range(9) for i in range(9)]
    faces = []
    for j in range(8):
        for i in range(8):
            face = (9 * j + i, 9 * j + i + 1, 9 * j + i + 10, 9 * j + i + 9)
            faces.append(tuple(reversed(face)) if flipped(i) else face)
    add("Grid", places, faces)
    add("Block", corners((-0.2, -0.2, 0.01), (0.2, 0.2, 0.4)), CUBE_FACES)
    lamp("SUN", (1, -1, 5), 3.0)
    camera((1.5, -2.5, 2.6), (0, 0, 0.2))


def shelter(down: bool) -> None:
    """A grid of 8 x 8 squares, half in the sun and half in a dark shed with an open side."""
    grid(lambda _: down)
    add("Shed", corners((-1.05, -1.05, -0.2), (0, 1.05, 0.9)), CUBE_FACES[1:])  # without the far side
    bpy.data.objects["Shed"].rotation_euler.z = np.pi
    camera((2.2, -2.0, 1.6), (0, 0, 0.1))


def curtain(into_room: bool, *, from_room: bool) -> None:
    """A curtain in the open side of a dim room, with the sun on it, seen from the room or from outside."""
    start()
    add("Room", corners((-1, -1, 0), (1, 1, 1.5)), [INWARD[n] for n in (0, 1, 3, 4, 5)])  # open towards -y
    face = (0, 1, 2, 3) if into_room else (3, 2, 1, 0)
    add("Curtain", [(1, -1, 0), (-1, -1, 0), (-1, -1, 1.5), (1, -1, 1.5)], [face])
    lamp("SUN", (0, -5, 3), 5.0)
    bpy.data.objects["Lamp"].rotation_euler.x = np.pi / 3  # down and towards y
    lamp("POINT", (0, 0.3, 1.2), 1.0)
    camera((0, 0.9, 0.7), (0, -1, 0.7)) if from_room else camera((0, -4, 0.7), (0, -1, 0.7))


def lampshade(height: float) -> None:
    """A lampshade, open above and below, with a lamp inside; seen from a height."""
    start()
    around = [(0.4 * np.cos(a), 0.4 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)]
    faces = [(i, (i + 1) % 12, 12 + (i + 1) % 12, 12 + i) for i in range(12)]
    add("Shade", [(x, y, z) for z in (0.0, 0.6) for x, y in around], faces)
    lamp("POINT", (0, 0, 0.3), 20.0)
    camera((0, -2.0, height), (0, 0, 0.3))


def box(inward: bool) -> None:
    """A closed box on the ground, seen from outside."""
    start()
    square("Ground", 3.0, 0.0)
    add("Box", corners((-0.5, -0.5, 0), (0.5, 0.5, 1)), INWARD if inward else CUBE_FACES)
    lamp("SUN", (1, -1, 5), 3.0)
    camera((1.5, -2.5, 1.6), (0, 0, 0.4))


def cylinder(inward: bool) -> None:
    """A closed smooth cylinder, tilted, seen from outside."""
    start(0.5)
    bpy.ops.mesh.primitive_cylinder_add(vertices=16, radius=0.3, depth=2.6, rotation=(1.4, 0.3, 0.9))
    item = bpy.context.object
    item.name = "Cylinder"
    item.data.polygons.foreach_set("use_smooth", [True] * len(item.data.polygons))
    if inward:
        item.data.flip_normals()
    square("Ground", 3.0, -1.5)
    lamp("SUN", (1, -1, 5), 2.0)
    camera((3, -6, 2), (0, 0, 0))


def ratios(sides: str = "six") -> list[float]:
    """Mean luminance over that of Cycles, of each camera."""
    bpy.context.view_layer.update()
    before = scene_snapshot()
    found = mean_ratios(size=(32, 24), max_samples=16, cameras=("all",), sides=sides)
    assert_unchanged(before)
    return found


SCENES = {
    "walls": lambda flip: room(not flip, closed=False),
    "walls in a bright world": lambda flip: room(not flip, closed=False, world=1.0),
    "closed room": lambda flip: room(not flip, closed=True),
    "box": lambda flip: box(flip),
    "cylinder": lambda flip: cylinder(flip),
    "sheet": lambda flip: sheet(flip),
    "ground": lambda flip: sheet(False, ground_down=flip),
    "half of a grid": lambda flip: grid(lambda column: flip and column < 4),
    "ground in a shed": shelter,
    "curtain from outside": lambda flip: curtain(flip, from_room=False),
    "curtain from the room": lambda flip: curtain(flip, from_room=True),
    "lampshade from above": lambda _: lampshade(1.6),
}


@pytest.mark.parametrize("flip", [False, True], ids=["right", "flipped"])
@pytest.mark.parametrize("scene", SCENES)
def test_light_is_that_of_cycles_however_normals_point(scene: str, flip: bool) -> None:
    SCENES[scene](flip)
    assert ratios() == [pytest.approx(1.0, abs=0.15)] * (2 if scene == "ground in a shed" else 1)


def test_a_lampshade_from_outside_is_dark() -> None:
    """But at its outline, where voxels show the 70 times as bright inner side of facets that the nearest ones hide."""
    lampshade(0.3)
    (seen,) = checked(depth=8, color=False, size=(32, 24), max_samples=16, cameras=("all",)).cameras
    inside = seen.cycles > 0.9 * seen.cycles.max()
    assert inside.sum() > 30
    assert np.median(seen.octree[inside] / seen.cycles[inside]) == pytest.approx(1.0, abs=0.15)
    assert (seen.octree[inside] < 2.0 * seen.cycles[inside]).mean() > 0.8


@pytest.mark.parametrize("scene", ["walls", "closed room", "sheet", "ground", "cylinder", "curtain from outside"])
def test_one_luminance_is_that_of_the_side_that_cameras_see(scene: str) -> None:
    SCENES[scene](True)
    assert ratios("one") == [pytest.approx(1.0, abs=0.15)]


@pytest.mark.parametrize("flip", [False, True], ids=["right", "flipped"])
def test_a_closed_room_seen_from_inside_and_from_outside(flip: bool) -> None:
    room(flip, closed=True)
    inside = bpy.context.scene.camera
    camera((0, -5.5, 1.4), (0, 1, 1))
    bpy.context.scene.camera = inside
    assert ratios() == [pytest.approx(1.0, abs=0.15)] * 2


@pytest.mark.parametrize("closed", ["box", "cylinder"])
def test_a_closed_surface_that_no_camera_has_seen_has_the_light_outside(closed: str) -> None:
    """Of a smooth one some triangles get light through its edges."""
    light = []
    for flip in (False, True):
        {"box": box, "cylinder": cylinder}[closed](flip)
        own = bake(depth=6, max_samples=16, denoise=False).fragments.of(closed.title())
        light.append(own.mean)
        assert not own.sides[:, 0 if flip else 1].any()
    assert light[1] == pytest.approx(light[0], rel=0.1)


@pytest.mark.parametrize("degrees", [89.0, 91.0, 120.0, 150.0])
def test_custom_normals_that_point_below_the_surface(degrees: float) -> None:
    """They see less of an even sky than half of it, as in Cycles, whose camera looks from above."""
    start(1.0)
    item = objects.slab()
    item.data.shade_smooth()
    angle = math.radians(degrees)
    item.data.normals_split_custom_set([(math.sin(angle), 0.0, math.cos(angle))] * len(item.data.loops))
    light, alpha = picture(64, 1)
    found = bake_surfels(64)
    assert found.luminance[found.place[:, 2] > -1e-4].mean() == pytest.approx(light.sum() / alpha.sum(), rel=0.1)
