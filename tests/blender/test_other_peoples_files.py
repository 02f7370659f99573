# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry and cameras as other people's files hold them, each against a render by Cycles."""

from collections.abc import Callable

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from patchnet.operators.verify_light import LightCheck
from patchnet.tests.blender.light_scene import assert_as_cycles, checked
from patchnet.tests.blender.objects import SQUARE, cuboid, lamp, link, look_from, mesh, read, slab
from patchnet.tests.blender.shaders import grey, image, material, read_by, shader, shown, simple, world

LEAST_PSNR_DB, RATIO = 26.0, 0.04

pytestmark = pytest.mark.usefixtures("empty_scene")


def paint(name: str, *rgb: float) -> bpy.types.Material:
    return simple(name=name, Color=(*rgb, 1.0))


def sheet(name: str, z: float, half: float, color: bpy.types.Material) -> bpy.types.Object:
    return link(mesh(name, [(x * half, y * half, z) for x, y, _ in SQUARE], [(0, 1, 2, 3)], color))


def rugs() -> None:
    """Two rugs closer to the floor than a voxel, one of the floor's own material."""
    floor = sheet("Floor", 0.0, 2.0, grey())
    sheet("Rug", 0.002, 0.8, paint("Rug", 0.8, 0.1, 0.05))
    sheet("Mat", 0.002, 0.5, floor.data.materials[0]).location.x = 1.3


def roof() -> None:
    cuboid("House", (-1.0, -1.0, 0.0), (1.0, 1.0, 0.8), grey(0.2))
    sheet("Roof", 0.8005, 1.2, paint("Roof", 0.8, 0.1, 0.05))
    slab("Ground", low=(-2, -2), high=(2, 2))


def bricks() -> None:
    """A wall of bricks that touch, whose inner faces nothing can see."""
    slab("Ground", low=(-2, -2), high=(2, 2))
    for row in range(4):
        for column in range(5):
            low = (0.4 * column - 1.0, 0.0, 0.25 * row)
            cuboid("Brick", low, (low[0] + 0.4, 0.3, low[2] + 0.25), grey(0.4 + 0.1 * ((row + column) % 3)))


def tent() -> None:
    """A closed tent of sheets on the ground, which is dark inside."""
    slab("Ground", low=(-2, -2), high=(2, 2))
    corners = [(x, y, z) for z in (-0.01, 1.0) for x, y, _ in SQUARE]
    link(mesh("Tent", corners, [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)], grey()))


@pytest.mark.parametrize("build", [rugs, roof, bricks, tent])
def test_sheets_and_faces_that_nearly_touch(build: Callable[[], None]) -> None:
    build()
    world().nodes["Background"].inputs["Strength"].default_value = 0.3
    lamp("SUN", 3.0).rotation_euler = (0.6, 0.2, 0.3)
    look_from((2.5, -3.5, 2.5), (0.0, 0.0, 0.4))
    assert_right()


def test_a_closed_tent_is_dark_inside() -> None:
    tent()
    lamp("SUN", 5.0)
    eye = look_from((0.0, -0.8, 0.4), (0.0, 1.0, 0.5))
    eye.data.lens = 20.0
    assert compared().cameras[0].octree.max() < 1e-3


def scaled(eye: bpy.types.Object) -> None:
    eye.scale.x = -1.0


def of_a_mirrored_parent(eye: bpy.types.Object) -> None:
    bpy.context.view_layer.update()
    mirrored = eye.matrix_world @ Matrix.Scale(-1.0, 4, (1.0, 0.0, 0.0))
    eye.parent = link(bpy.data.objects.new("Rig", None))
    eye.parent.scale.y = -1.0
    bpy.context.view_layer.update()
    eye.matrix_world = mirrored


def orthographic(eye: bpy.types.Object) -> None:
    eye.data.type, eye.data.ortho_scale, eye.scale.y = "ORTHO", 4.0, -1.0


@pytest.mark.parametrize("mirror", [scaled, of_a_mirrored_parent, orthographic])
def test_mirrored_cameras(mirror: Callable[[bpy.types.Object], None]) -> None:
    """Open sheets whose sides differ, which a camera decides."""
    slab("Ground", low=(-2, -2), high=(2, 2))
    for x, tilt in ((-0.8, 0.4), (0.5, -0.9)):
        sheet("Card", 0.0, 0.5, paint("Card", 0.2, 0.5, 0.8)).matrix_world = Matrix.Translation(
            (x, 0.0, 0.6)
        ) @ Matrix.Rotation(tilt, 4, "X")
    lamp("SUN", 3.0).rotation_euler = (0.6, 0.2, 0.3)
    mirror(look_from((1.5, -4.0, 2.0), (0.0, 0.0, 0.4)))
    assert_right()


@pytest.mark.parametrize("kind", ["Emission", "BsdfPrincipled"])
def test_screens_are_as_sharp_as_their_images(kind: str) -> None:
    """Emission of an image whose texels are two or three voxels wide."""
    slab("Ground", low=(-2, -2), high=(2, 2))
    squares = np.random.default_rng(3).random((16, 16, 1)) < 0.5
    texture = image("Film", np.broadcast_to(squares, (16, 16, 4)))
    texture.pack()
    film, tree = material("Film")
    color = read_by("TexImage", image=texture, interpolation="Closest")
    values = {"Base_Color": (0, 0, 0, 1), "Emission_Strength": 1.0} if kind == "BsdfPrincipled" else {}
    surface = shader(tree, kind, **values)
    tree.links.new(color(tree), surface.node.inputs["Emission Color" if values else "Color"])
    shown(tree, surface)
    screen = sheet("Screen", 0.0, 0.6, film)
    screen.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    screen.location.z, screen.rotation_euler.x = 0.7, 1.4
    lamp("SUN", 9.0).rotation_euler = (0.6, 0.2, 0.3)
    look_from((0.4, -2.4, 1.0), (0.0, 0.0, 0.6))
    assert_right(20.0)


def test_custom_normals_below_the_surface_are_named() -> None:
    right, wrong = cuboid("Right", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), grey()), slab("Wrong")
    right.data.normals_split_custom_set([each.vector for each in right.data.corner_normals])
    wrong.data.normals_split_custom_set_from_vertices([(0.0, 0.0, 1.0)] * len(wrong.data.vertices))
    (note,) = read().warnings
    assert note.startswith("Custom normals of 'Wrong' point below the surface")


def compared() -> LightCheck:
    return checked(depth=7, size=(48, 48), max_samples=8, noise_threshold=1e-4, rays=4)


def assert_right(least_psnr_db: float = LEAST_PSNR_DB) -> None:
    """Check the octree's light in the active camera against Cycles."""
    check = compared()
    assert_as_cycles(check, least_psnr_db, RATIO)
    assert check.report["cameras"][0]["both_hit_share"] > 0.3
