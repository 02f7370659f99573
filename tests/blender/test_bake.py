# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked light against light computed by hand; the scene stays unchanged."""

import bpy
import numpy as np
import pytest
from mathutils import Euler, Vector

from patchnet.operators.cycles.bake import BakeJob, bake_light, bake_scene, baker
from patchnet.operators.cycles.bake.bake_call import BakeTarget
from patchnet.operators.scene_access.devices import gpu_is_enabled
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.tests.blender.light_scene import bake, bake_job, bake_surfels, on_bake
from patchnet.tests.blender.objects import CUBE_FACES, SQUARE, corners, lamp, link, look_from, mesh
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import added, material, read_by, shader, shown, simple

pytestmark = pytest.mark.usefixtures("empty_scene")


def diffuse(color: tuple[float, float, float] = (0.5, 0.5, 0.5), emission: float = 0.0) -> bpy.types.Material:
    """Diffuse plus emission."""
    paint, tree = material("Diffuse")
    light = shader(tree, "Emission", Strength=emission)
    shown(tree, added(tree, shader(tree, "BsdfDiffuse", Color=(*color, 1.0)), light))
    return paint


def square(name: str, paint: bpy.types.Material | None = None, up: bool = True) -> bpy.types.Object:
    return link(mesh(name, SQUARE, [(0, 1, 2, 3) if up else (3, 2, 1, 0)], paint))


def cube(paint: bpy.types.Material | None = None, inside_out: bool = False) -> bpy.types.Object:
    faces = [face[::-1] if inside_out else face for face in CUBE_FACES]
    return link(mesh("Cube", corners((-1.0,) * 3, (1.0,) * 3), faces, paint))


def sun(strength: float, rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    item = lamp("SUN", strength, angle=0.0)
    item.rotation_euler = rotation
    return item


def look_around(place: tuple[float, float, float], name: str) -> list[str]:
    """Names of new cameras that see everything around a place."""
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    for number, way in enumerate(ways):
        look_from(place, tuple(place + way), f"{name} {number}").data.lens = 12.0
    return [f"{name} {number}" for number in range(len(ways))]


def test_closed_box_under_the_sun_is_lambertian() -> None:
    cube(diffuse((0.5, 0.5, 0.5))).data.shade_flat()
    light = sun(3.0, (0.5, 0.3, 0.0))
    baked = bake(max_samples=16)
    towards = np.array(light.matrix_world.to_3x3() @ Vector((0, 0, 1)))
    (batch,) = baked.source.batches()
    expected = np.maximum(triangle_areas_and_normals(batch.corners_world)[1] @ towards, 0.0) * 3.0 * 0.5 / np.pi
    found = baked.fragments
    np.testing.assert_allclose(found.luminance, expected[found.triangle], atol=1e-3)


# Sun from below, whether the material culls, and the one luminance of sheets that face up and down.
SHEETS = {
    "a dark front does not count": (0.0, False, (3.0, 3.0)),
    "both sides": (1.0, False, (3.0, 1.0)),
    "shade is shade": (0.3, False, (3.0, 0.3)),
    "next to no light is that of the inside of a building": (0.003, False, (3.0, 3.0)),
    "Cycles culls nothing": (1.0, True, (3.0, 1.0)),
    "a dark front of a material that culls": (0.0, True, (3.0, 3.0)),
}


@pytest.mark.parametrize("case", SHEETS)
def test_sides_of_sheets(case: str) -> None:
    below, culls, wanted = SHEETS[case]
    paint = diffuse()
    paint.use_backface_culling = culls
    sun(3.0), sun(below, (np.pi, 0.0, 0.0))
    for index, name in enumerate(("Up", "Down")):
        square(name, paint, up=name == "Up").location = (10 * index, 0, 0)
    found = bake(depth=6, max_samples=4).fragments
    for name, sides, one in zip(("Up", "Down"), ((3.0, below), (below, 3.0)), wanted, strict=True):
        own = found.of(name)
        assert own.mean_sides == pytest.approx(np.array(sides) * 0.5 / np.pi, rel=1e-3)
        assert own.mean == pytest.approx(one * 0.5 / np.pi, rel=1e-3)


def test_the_one_luminance_is_that_of_the_side_that_cameras_see() -> None:
    sun(3.0), sun(1.0, (np.pi, 0.0, 0.0))
    square("Sheet", diffuse())
    for name, height in (("Above", 5.0), ("Below", -5.0)):
        look_from((0.2, 0.1, height), (0.0, 0.0, 0.0), name)
    for cameras, wanted in ((("Above",), 3.0), (("Below",), 1.0), (("Above", "Below"), 3.0)):
        found = bake(cameras=cameras, max_samples=4).fragments
        assert found.mean == pytest.approx(wanted * 0.5 / np.pi, rel=1e-3)
        assert found.mean_sides == pytest.approx(np.array([3.0, 1.0]) * 0.5 / np.pi, rel=1e-3)


@pytest.mark.parametrize("inside_out", [False, True])
def test_closed_boxes_have_the_light_of_the_side_that_cameras_see(inside_out: bool) -> None:
    cube(diffuse((0.5, 0.5, 0.5)), inside_out)
    lamp("POINT", 40.0, (0.0, 0.0, 0.0), shadow_soft_size=0.01)
    sun(2.0)
    bpy.context.scene.cycles.diffuse_bounces = 0
    inside = look_around((0.1, 0.2, 0.0), "Inside")
    look_from((0.0, -9.0, 1.0), (0.0, 0.0, 0.0), "Outside")
    inner, outer = (0, 1) if inside_out else (1, 0)
    lit_inside, lit_outside = 40.0 / 24.0 * 0.5 / np.pi, 2.0 * 0.5 / np.pi  # the lamp's 40 W fall on 24 square metres
    found = bake(cameras=inside, max_samples=64).fragments
    assert found.mean == pytest.approx(lit_inside, rel=0.02) and not found.sides[:, outer].any()
    for cameras in (["Outside"], []):
        found = bake(cameras=cameras, max_samples=16).fragments
        top = found.only(found.place[:, 2] > 0.999)
        assert top.mean == pytest.approx(lit_outside, rel=0.02) and not found.sides[:, inner].any()
    found = bake(cameras=[*inside, "Outside"], max_samples=64).fragments
    assert found.mean_sides[inner] == pytest.approx(lit_inside, rel=0.02)
    assert found.only(found.place[:, 2] > 0.999).mean_sides[outer] == pytest.approx(lit_outside, rel=0.02)


def test_the_outside_of_a_hollow_wall_is_lit_where_no_camera_looks() -> None:
    """Its coarse light cells also hold the dark back of the inside, which faces as the outside does."""
    x, y, z = 0.15, 2.0, 1.0
    without_floor = [(0, 1, 3, 2), (6, 7, 5, 4), (0, 4, 5, 1), (3, 7, 6, 2), (1, 5, 7, 3)]
    link(mesh("Wall", corners((-x, -y, -z), (x, y, z)), without_floor, diffuse()))
    square("Stone", diffuse()).location = (1.6, 0.0, -1.1)  # so that no light cells meet within the wall
    sun(2.0, (0.0, np.pi / 2.0, 0.0))  # from +x
    bpy.context.scene.cycles.diffuse_bounces = 0
    look_from((-6.0, 0.0, 0.0), (0.0, 0.0, 0.0), "Inside")
    found = bake(depth=7, cameras=["Inside"], max_samples=4).fragments.of("Wall")
    outside = found.only(found.place[:, 0] > x - 1e-4)
    np.testing.assert_allclose(outside.luminance, 2.0 * 0.5 / np.pi, rtol=1e-3)


def test_a_translucent_sheet_in_a_box_has_the_mean_of_its_sides() -> None:
    cube(diffuse((0.5, 0.5, 0.5)))
    paint = diffuse((0.0, 0.0, 0.0))
    tree = paint.node_tree
    tree.nodes.new("ShaderNodeBsdfTranslucent")
    strength = tree.nodes.new("ShaderNodeMath")
    strength.operation = "MULTIPLY_ADD"
    strength.inputs[1].default_value, strength.inputs[2].default_value = 0.4, 0.4
    tree.links.new(read_by("NewGeometry", "Backfacing")(tree), strength.inputs[0])
    tree.links.new(strength.outputs[0], tree.nodes["Emission"].inputs["Strength"])
    square("Sheet", paint).scale = (0.5, 0.5, 0.5)
    found = bake(cameras=look_around((0.1, 0.2, 0.3), "Inside"), max_samples=16).fragments
    assert found.of("Cube").luminance.min() > 0.0
    assert found.of("Sheet").mean_sides == pytest.approx(np.array([0.4, 0.8]), rel=1e-3)
    assert found.of("Sheet").mean == pytest.approx(0.6, rel=1e-3)


def test_cells_whose_few_paths_met_darkness_get_more() -> None:
    """Of six lamps, five shine on other things, so that most first paths of a surfel find none; without a filter."""
    cube(diffuse((0.5, 0.5, 0.5)), inside_out=True)
    lamp("POINT", 40.0, (0.0, 0.0, 0.0), shadow_soft_size=0.01)
    for number in range(5):
        sun(1.0 + number)
    bpy.context.scene.cycles.diffuse_bounces, bpy.context.scene.cycles.use_light_tree = 0, False
    found = bake(cameras=look_around((0.1, 0.2, 0.0), "Inside"), max_samples=256, denoise=False).fragments
    assert found.mean == pytest.approx(40.0 / 24.0 * 0.5 / np.pi, rel=0.02)


def test_furnace() -> None:
    """In a closed room of albedo a where everything emits e, light is e / (1 - a), after all bounces."""
    cube(diffuse((0.5, 0.5, 0.5), emission=0.3), inside_out=True)
    cycles = bpy.context.scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = 24
    found = bake(depth=4, cameras=look_around((0.0, 0.0, 0.0), "Eye"), max_samples=64).fragments
    assert found.mean == pytest.approx(0.6, rel=0.02)
    assert found.luminance.std() < 0.05


def test_emission_and_mixed_alpha() -> None:
    square("Lamp", diffuse((0.0, 0.0, 0.0), emission=2.5)).location = (50, 0, 0)
    half = {"Base_Color": (0.5, 0.5, 0.5, 1.0), "Specular_IOR_Level": 0.0, "Alpha": 0.75}
    square("Pane", simple("BsdfPrincipled", "Glassy", **half))
    sun(3.0)
    found = bake(depth=8, max_samples=16).fragments
    assert found.of("Lamp").mean == pytest.approx(2.5, rel=1e-3)
    assert found.of("Pane").sides[:, 0].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=5e-3), "opacity is divided out"


def test_surfels_of_a_call_do_not_mix() -> None:
    """Each has texels of its own; those of a translucent material are baked apart, and added."""
    for index in range(5):
        paint = diffuse((0.0, 0.0, 0.0), emission=1.0 + index)
        if index == 2:
            paint.node_tree.nodes.new("ShaderNodeBsdfTranslucent")
        link(mesh(f"Half {index}", SQUARE[:3], [(0, 1, 2)], paint), (0.0, 0.0, 0.5 * index))
    found = bake_surfels(2)
    assert len(found.surfels) > 500
    for index in range(5):
        np.testing.assert_allclose(found.luminance[found.names == f"Half {index}"], 1.0 + index, rtol=1e-5)


def user_scene() -> dict:
    """A scene with settings that a careless bake would change."""
    scene = bpy.context.scene
    floor = square("Floor", diffuse())
    floor.data.uv_layers.new(name="Mine")
    cube(diffuse((0.2, 0.4, 0.6), 0.1)).location.z = 3
    square("No material").location.x = 5
    sun(3.0)
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.cycles.samples, scene.cycles.sample_clamp_indirect = 77, 3.0
    scene.render.bake.margin = 5
    floor.select_set(True)
    bpy.context.view_layer.objects.active = bpy.data.objects["Cube"]
    bpy.data.objects["Sun"].rotation_euler = Euler((0.2, 0.3, 0.1))
    bpy.context.view_layer.update()
    return scene_snapshot()


def small_job() -> BakeJob:
    return bake_job(depth=4, max_samples=2)


def test_scene_is_unchanged_after_cancel_and_error(monkeypatch: pytest.MonkeyPatch) -> None:
    before = user_scene()
    steps = bake_light(small_job())
    while next(steps).label != "Baking light":
        pass
    steps.close()
    assert_unchanged(before)

    def fail(target: BakeTarget) -> None:
        assert target.item.name in target.scene.objects
        raise RuntimeError("the device is gone")

    on_bake(monkeypatch, fail)
    with pytest.raises(RuntimeError, match="device"):
        drain(bake_light(small_job()))
    assert_unchanged(before)


def test_tiles_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    user_scene()
    found = []
    for side in (4096, 8):
        monkeypatch.setattr(bake_scene, "tile_side", lambda side=side: side)
        found.append(bake_surfels(4))
    assert len(found[0].surfels) > 2 * 8 * 8
    np.testing.assert_array_equal(found[0].luminance, found[1].luminance)


@pytest.mark.parametrize("enabled", [False, True])
def test_gpus_bake_where_they_are_enabled(enabled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Device that Cycles is asked for; without a GPU it takes the processor all the same."""
    before = user_scene()
    devices = []
    on_bake(monkeypatch, lambda target: devices.append(target.scene.cycles.device))
    monkeypatch.setattr(baker, "bakes_on_gpu", lambda context, device: enabled or gpu_is_enabled(context))
    drain(bake_light(small_job()))
    assert set(devices) == {"GPU" if enabled or gpu_is_enabled(bpy.context) else "CPU"}
    assert_unchanged(before)


def test_a_failing_bake_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    item = square("Floor", diffuse())
    item.hide_render = True
    scene, layer = bpy.context.scene, bpy.context.view_layer
    with pytest.raises(SceneError, match="Cycles cannot bake"):
        baker.bake_now(bpy.context, BakeTarget(scene, layer, item, bpy.data.images.new("Any", 4, 4)))
