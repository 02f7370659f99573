# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces whose normals point the wrong way: what light they get, and which objects a warning names."""

import json
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Vector

from patchnet.operators.cycles.bake.side_probe import light_of_sides
from patchnet.operators.pipeline.run import JobResult, run_job
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.runtime.progress import Progress, drain
from patchnet.tests.blender.light_scene import CUBE_FACES
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

Place = tuple[float, float, float]
INWARD = [tuple(reversed(face)) for face in CUBE_FACES]
FROM_BEHIND = "seen from behind"


def start(world: float = 0.05) -> None:
    """Nothing but a gray world, as strong as Blender's own."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0, 0):
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (world, world, world, 1.0)


def add(name: str, corners: list[Place], faces: list[tuple[int, ...]]) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    material = bpy.data.materials.get("Gray") or bpy.data.materials.new("Gray")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.6, 0.6, 0.6, 1.0)
    mesh.materials.append(material)
    item = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(item)
    return item


def corners_of(low: Place, high: Place) -> list[Place]:
    return [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]


def square(name: str, half: float, z: float, down: bool = False) -> None:
    face = (3, 2, 1, 0) if down else (0, 1, 2, 3)
    add(name, [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)], [face])


def lamp(kind: str, place: Place, energy: float) -> None:
    data = bpy.data.lights.new("Lamp", kind)
    data.energy = energy
    item = bpy.data.objects.new("Lamp", data)
    item.location = place
    bpy.context.scene.collection.objects.link(item)


def camera(place: Place, target: Place) -> None:
    data = bpy.data.cameras.new("Camera")
    data.lens, data.clip_start = 20.0, 0.01
    item = bpy.data.objects.new("Camera", data)
    item.location = place
    item.rotation_euler = (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(item)
    bpy.context.scene.camera = item


def room(inward: bool, *, closed: bool, lit: bool = True, world: float = 0.05) -> None:
    """A room seen from inside, of six walls that are objects of their own or of one closed mesh, with a table."""
    start(world)
    corners, faces = corners_of((-2, -2, 0), (2, 2, 2.5)), INWARD if inward else CUBE_FACES
    if closed:
        add("Walls", corners, faces)
    else:
        for number, face in enumerate(faces):
            add(f"Wall {number}", [corners[corner] for corner in face], [(0, 1, 2, 3)])
    add("Table", corners_of((-0.5, 0.3, 0.01), (0.5, 1, 0.7)), CUBE_FACES)
    if lit:
        lamp("POINT", (0, 0, 2.2), 50.0)
    camera((0, -1.8, 1.4), (0, 1, 1))


def sheet(down: bool) -> None:
    """A sheet in the sun above the ground, seen from above."""
    start()
    square("Ground", 3.0, 0.0)
    square("Sheet", 1.0, 0.6, down)
    lamp("SUN", (1, -1, 5), 3.0)
    camera((1.5, -2.5, 2.6), (0, 0, 0.4))


def grid(flipped: Callable[[int], bool]) -> None:
    """A grid of 8 x 8 squares in the sun, some of whose columns point down, with a block on it."""
    start()
    corners = [(-1 + i / 4, -1 + j / 4, 0.0) for j in range(9) for i in range(9)]
    faces = []
    for j in range(8):
        for i in range(8):
            face = (9 * j + i, 9 * j + i + 1, 9 * j + i + 10, 9 * j + i + 9)
            faces.append(tuple(reversed(face)) if flipped(i) else face)
    add("Grid", corners, faces)
    add("Block", corners_of((-0.2, -0.2, 0.01), (0.2, 0.2, 0.4)), CUBE_FACES)
    lamp("SUN", (1, -1, 5), 3.0)
    camera((1.5, -2.5, 2.6), (0, 0, 0.2))


def box(inward: bool) -> None:
    """A closed box on the ground, seen from outside."""
    start()
    square("Ground", 3.0, 0.0)
    add("Box", corners_of((-0.5, -0.5, 0), (0.5, 0.5, 1)), INWARD if inward else CUBE_FACES)
    lamp("SUN", (1, -1, 5), 3.0)
    camera((1.5, -2.5, 1.6), (0, 0, 0.4))


def run(**values: object) -> JobResult:
    wanted = {"depth": 6, "size": (32, 24), "samples": 4, "budget": 0.01, "background": "black"} | values
    return drain(run_job(bpy.context, JobSettings.of(**wanted)))


def said(result: JobResult) -> str:
    return " ".join(warning for warning in result.warnings if FROM_BEHIND in warning)


def seen_light(result: JobResult) -> float:
    """Median light of what the camera sees."""
    buffers = result.views[0].buffers
    return float(np.median(buffers.preview[buffers.hit])) / result.coded.octree.exposure


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: room(False, closed=False), "'Wall 0'"),
        (lambda: room(False, closed=True), "'Walls'"),
        (lambda: sheet(True), "'Sheet'"),
        (lambda: grid(lambda column: column < 4), "'Grid'"),
    ],
)
def test_flipped_surfaces_that_look_too_dark_are_named(build: Callable[[], None], named: str) -> None:
    build()
    bpy.context.view_layer.update()
    before = scene_snapshot()
    result = run()
    assert_unchanged(before)
    assert named in said(result) and "--both-sides" in said(result)
    assert "'Table'" not in said(result) and "'Ground'" not in said(result) and "'Block'" not in said(result)


@pytest.mark.parametrize(
    "build",
    [
        lambda: room(True, closed=False),
        lambda: room(True, closed=True),
        lambda: room(True, closed=False, world=1.0),
        lambda: room(True, closed=True, lit=False),
        lambda: room(False, closed=False, lit=False),
        lambda: sheet(False),
        lambda: grid(lambda _: False),
        lambda: box(False),
    ],
    ids=["room", "closed room", "room in a bright world", "cellar", "flipped cellar", "sheet", "grid", "box"],
)
def test_what_is_right_or_dark_on_both_sides_is_not_named(build: Callable[[], None]) -> None:
    build()
    assert said(run()) == ""


def test_a_closed_box_with_flipped_normals_has_the_light_outside() -> None:
    box(False)
    right = seen_light(run())
    box(True)
    flipped = run()
    assert said(flipped) == ""
    assert seen_light(flipped) == pytest.approx(right, rel=0.05)


@pytest.mark.parametrize("closed", [False, True])
def test_walls_whose_front_sees_nothing_lit_have_the_light_of_the_room(closed: bool) -> None:
    room(True, closed=closed, world=0.0)
    right = seen_light(run())
    room(False, closed=closed, world=0.0)
    flipped = run()
    assert said(flipped) == ""
    assert seen_light(flipped) == pytest.approx(right, rel=0.1)


def test_both_sides_helps_and_says_nothing() -> None:
    sheet(True)
    dark, both = run(), run(both_sides=True)
    assert said(both) == ""
    mine = dark.views[0].buffers.hits
    normals = dark.coded.octree.normal_float(np.maximum(mine.node, 0))
    behind = mine.hit & (np.einsum("pc,pc->p", normals, mine.direction) > 0.2)
    before, after = (
        float(result.views[0].buffers.preview[behind].mean()) / result.coded.octree.exposure for result in (dark, both)
    )
    assert behind.sum() > 20 and after > 1.5 * before


def test_the_report_has_the_warning(tmp_path: Path) -> None:
    sheet(True)
    result = run(out=tmp_path / "out")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert said(result) in report["warnings"]


def test_the_probe_measures_both_sides() -> None:
    """Sun of 3 W/m2 from above on a white surface: 3 / pi, and from below the world alone; under a roof less."""
    start(0.5)
    lamp("SUN", (0, 0, 5), 3.0)
    points = np.array([[0.3, 0.1, 0.0], [-0.5, 0.2, 0.0], [0.9, 0.9, 0.1]])
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    square("Ground", 1.0, 0.0)
    bpy.context.view_layer.update()
    before = scene_snapshot()
    found = drain(light_of_sides(bpy.context, points, normals, 1e-4, with_daylight=False, at=Progress(0, 1, "Looking")))
    assert_unchanged(before)
    above = 3.0 / np.pi + 0.5
    np.testing.assert_allclose(found[0], (above, 0.5), rtol=0.02)
    np.testing.assert_allclose(found[1], (0.5, above), rtol=0.02)
    assert found[2, 1] < 0.9 * above and found[2, 0] == pytest.approx(above, rel=0.02)
