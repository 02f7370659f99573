# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces whose normals point the wrong way: which side's light they get, and which objects a warning names."""

import json
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Vector

from patchnet.operators.cycles.bake import bake_luminance
from patchnet.operators.cycles.bake.side_probe import light_of_sides
from patchnet.operators.pipeline.lit_octree import build_lit_octree
from patchnet.operators.pipeline.run import JobResult, run_job
from patchnet.operators.scene.cameras import choose_cameras
from patchnet.operators.scene.read import read_scene
from patchnet.operators.scene.scene_mesh import SceneMesh
from patchnet.operators.settings.groups import LightSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.chart_lookup import triangle_means
from patchnet.patchnet_addon.runtime.progress import Progress, drain
from patchnet.patchnet_addon.runtime.stage_clock import StageClock
from patchnet.tests.blender import objects, shaders
from patchnet.tests.blender.objects import CUBE_FACES, link, look_from, mesh
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import simple

Place = tuple[float, float, float]
INWARD = [tuple(reversed(face)) for face in CUBE_FACES]
FROM_BEHIND = "seen from behind"


def start(world: float = 0.05) -> None:
    """Nothing but a gray world, as strong as Blender's own."""
    bpy.ops.wm.read_homefile(use_empty=True)
    shaders.world().nodes["Background"].inputs["Color"].default_value = (world, world, world, 1.0)


def add(name: str, corners: list[Place], faces: list[tuple[int, ...]]) -> bpy.types.Object:
    paint = bpy.data.materials.get("Gray") or simple("BsdfPrincipled", "Gray", Base_Color=(0.6, 0.6, 0.6, 1.0))
    return link(mesh(name, corners, faces, paint))


def corners_of(low: Place, high: Place) -> list[Place]:
    return [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]


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


def shelter(down: bool) -> None:
    """A grid of 8 x 8 squares, half in the sun and half in a dark shed with an open side."""
    grid(lambda _: down)
    add("Shed", corners_of((-1.05, -1.05, -0.2), (0, 1.05, 0.9)), CUBE_FACES[1:])  # without the far side
    bpy.data.objects["Shed"].rotation_euler.z = np.pi
    camera((2.2, -2.0, 1.6), (0, 0, 0.1))


def curtain(into_room: bool, *, from_room: bool) -> None:
    """A curtain in the open side of a dim room, with the sun on it, seen from the room or from outside."""
    start()
    add("Room", corners_of((-1, -1, 0), (1, 1, 1.5)), [INWARD[n] for n in (0, 1, 3, 4, 5)])  # open towards -y
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
    add("Box", corners_of((-0.5, -0.5, 0), (0.5, 0.5, 1)), INWARD if inward else CUBE_FACES)
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


def seen_from_both_sides() -> None:
    """A closed room with normals to the outside, seen from inside and, its walls in the world's light, from outside."""
    room(False, closed=True)
    inside = bpy.context.scene.camera
    camera((0, -3.5, 1.4), (0, 1, 1))
    bpy.context.scene.camera = inside


def run(**values: object) -> JobResult:
    wanted = {"depth": 6, "size": (32, 24), "samples": 16, "budget": 0.01, "background": "black"} | values
    return drain(run_job(bpy.context, JobSettings.of(**wanted)))


def said(result: JobResult) -> str:
    return " ".join(warning for warning in result.warnings if FROM_BEHIND in warning)


def turned(result: JobResult) -> list[str]:
    """Names of the objects that show their back."""
    return list(result.report["light"].get("turned_objects", []))


def picture(result: JobResult) -> np.ndarray:
    """Light of what the camera sees."""
    buffers = result.views[0].buffers
    return np.asarray(buffers.preview[buffers.hit] / result.coded.octree.exposure)


DECIDED = {
    "walls": (lambda flip: room(not flip, closed=False), [f"Wall {number}" for number in range(6)]),
    "closed room": (lambda flip: room(not flip, closed=True), ["Walls"]),
    "box": (lambda flip: box(flip), ["Box"]),
    "cylinder": (lambda flip: cylinder(flip), ["Cylinder"]),
    "sheet": (lambda flip: sheet(flip), ["Sheet"]),
    "ground": (lambda flip: sheet(False, ground_down=flip), ["Ground"]),
    "half of a grid": (lambda flip: grid(lambda column: flip and column < 4), ["Grid"]),
    "ground in a shed": (shelter, ["Grid"]),
    "curtain from outside": (lambda flip: curtain(flip, from_room=False), ["Curtain"]),
}


@pytest.mark.parametrize("case", DECIDED)
def test_sheets_seen_from_behind_where_the_light_is_look_as_if_they_were_right(case: str) -> None:
    build, names = DECIDED[case]
    build(False)
    right = run()
    assert turned(right) == [] and said(right) == ""
    build(True)
    bpy.context.view_layer.update()
    before = scene_snapshot()
    flipped = run()
    assert_unchanged(before)
    assert set(turned(flipped)) <= set(names) and turned(flipped) and said(flipped) == ""
    wanted, found = picture(right), picture(flipped)
    assert len(wanted) == len(found)
    assert np.abs(found - wanted).mean() < 0.1 * wanted.mean()


@pytest.mark.parametrize(
    ("build", "named"),
    [(lambda: seen_from_both_sides(), "'Walls'"), (lambda: lampshade(1.6), "'Shade'")],
    ids=["closed room", "lampshade from above"],
)
def test_what_light_cannot_decide_is_named(build: Callable[[], None], named: str, tmp_path: Path) -> None:
    build()
    bpy.context.view_layer.update()
    before = scene_snapshot()
    result = run(out=tmp_path / "out", cameras=("all",))
    assert_unchanged(before)
    assert turned(result) == []
    assert named in said(result) and ("Both Sides: On" in said(result)) == (named == "'Shade'"), "no help if closed"
    assert "'Table'" not in said(result)
    assert said(result) in json.loads((tmp_path / "out" / "report.json").read_text())["warnings"]


@pytest.mark.parametrize(
    "build",
    [
        lambda: room(True, closed=False, world=1.0),
        lambda: room(True, closed=True, lit=False),
        lambda: room(False, closed=False, lit=False),
        lambda: curtain(True, from_room=True),
        lambda: lampshade(0.3),
    ],
    ids=["room in a bright world", "cellar", "flipped cellar", "curtain", "lampshade"],
)
def test_what_is_right_or_dark_on_both_sides_stays_and_is_not_named(build: Callable[[], None]) -> None:
    build()
    result = run()
    assert said(result) == "" and turned(result) == []


def pipe(inward: bool) -> None:
    """A bevelled curve, open, into whose near end sun and camera look; a cube, a box, and a sheet seen from behind."""
    box(inward)
    add("Cube", corners_of((0.8, -0.5, 0.01), (1.4, 0.1, 0.6)), CUBE_FACES)
    add("Sheet", [(-0.5, 1.0, 0.1), (0.5, 1.0, 0.1), (0.5, 1.0, 1.4), (-0.5, 1.0, 1.4)], [(3, 2, 1, 0)])
    data = bpy.data.curves.new("Pipe", "CURVE")
    data.dimensions, data.bevel_depth = "3D", 0.16
    data.splines.new("POLY").points.add(1)
    for point, place in zip(data.splines[0].points, ((-0.9, 0.6, 0.3), (-0.5, -0.8, 0.9)), strict=True):
        point.co = (*place, 1.0)
    data.materials.append(bpy.data.materials["Gray"])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Pipe", data))
    lamp_object = bpy.data.objects["Lamp"]
    lamp_object.rotation_euler = (Vector((0, 0, 0.4)) - Vector((1.5, -2.5, 1.6))).to_track_quat("-Z", "Y").to_euler()


def test_who_is_named() -> None:
    """Neither a curve at whose end one looks in, a cube, nor a sheet from behind; a box that is inside out is."""
    pipe(False)
    right = run()
    pipe(True)
    flipped = run()
    notes = [[text for text in result.warnings if "ormals" in text] for result in (right, flipped)]
    assert notes[0] == []
    (note,) = notes[1]
    assert note.startswith("Normals of 'Box' point inward") and set(turned(flipped)) == {"Box", "Sheet"}


@pytest.mark.parametrize("closed", ["box", "cylinder"])
def test_a_closed_surface_that_no_camera_has_seen_has_the_light_outside(closed: str) -> None:
    """Of a smooth one some triangles get light through its edges."""
    light = []
    for flip in (False, True):
        {"box": box, "cylinder": cylinder}[closed](flip)
        source, atlas = baked(look=False)
        own = np.flatnonzero(triangles_of(source, closed.title()))
        light.append(triangle_means(atlas.charts, atlas.texels, own)[:, 0].mean())
    assert light[1] == pytest.approx(light[0], rel=0.1)


def test_every_way_to_the_octree_asks_the_cameras() -> None:
    sheet(True)
    settings = JobSettings.of(depth=5, samples=1, size=(32, 24))
    made = drain(build_lit_octree(bpy.context, settings, StageClock()))
    assert made.octree.provenance["turned_objects"] == ["Sheet"]
    bpy.data.objects.remove(bpy.data.objects["Camera"])
    made = drain(build_lit_octree(bpy.context, settings, StageClock()))
    assert "turned_objects" not in made.octree.provenance


def baked(*, look: bool) -> tuple[SceneMesh, Atlas]:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    source = read_scene(depsgraph, "VISIBLE")
    cameras = choose_cameras(depsgraph, (), (32, 24), source.bounds_world) if look else ()
    light = LightSettings(samples=16, denoise=False)
    return source, drain(bake_luminance(bpy.context, source, 0.1, light, cameras=cameras))


def triangles_of(source: SceneMesh, name: str) -> np.ndarray:
    owners = [owner for part in source.parts for owner in part.objects for _ in range(len(part.mesh))]
    return np.array(owners) == name


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
