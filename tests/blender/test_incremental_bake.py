# SPDX-License-Identifier: GPL-3.0-or-later
"""Incremental bakes: what moved, its shadow and what is near are baked again, the rest stays, and is right."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles.bake import baker
from patchnet.operators.cycles.bake.bake import bake_luminance
from patchnet.operators.cycles.bake.scene_items import change_of, emission_at_most, scene_items, sky_luminance
from patchnet.operators.demo_scene.geometry import box, place
from patchnet.operators.demo_scene.materials import principled
from patchnet.operators.scene.read import read_scene
from patchnet.operators.scene.scene_mesh import SceneMesh
from patchnet.operators.settings.groups import LightSettings
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.chart_lookup import triangle_means
from patchnet.patchnet_addon.lightmap.incremental import follow
from patchnet.patchnet_addon.lightmap.incremental.follow import albedo_of
from patchnet.patchnet_addon.runtime.progress import Steps, drain
from patchnet.tests.blender.corridor import BOX, LENGTH, build_corridor, subdivide

pytestmark = pytest.mark.usefixtures("empty_scene", "own_cache")

TOLERANCE = 0.02


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATCHNET_CACHE", str(tmp_path / "cache"))


def baked(incremental: bool = True, samples: int = 16, **settings: Any) -> tuple[SceneMesh, Atlas]:
    bpy.context.view_layer.update()
    source = read_scene(bpy.context.evaluated_depsgraph_get(), "VISIBLE")
    given = {"daylight": False, "denoise": False, "color": False, "tolerance": TOLERANCE} | settings
    light = LightSettings(samples=samples, incremental=incremental, **given)
    return source, drain(bake_luminance(bpy.context, source, 0.2, light))


def means(source: SceneMesh, atlas: Atlas) -> np.ndarray:
    return triangle_means(atlas.charts, atlas.texels, np.arange(source.triangle_count))[:, 0]


def along(source: SceneMesh) -> np.ndarray:
    """Place (T,) of the triangles along the corridor."""
    return np.concatenate([batch.corners_world for batch in source.batches()]).mean(axis=1)[:, 0]


def notes(atlas: Atlas) -> dict[str, Any]:
    return atlas.notes["incremental"]


@pytest.fixture
def bounds(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """By how much each triangle's light was said to change at most, (T,) of each bake that followed a change."""
    found: list[np.ndarray] = []
    real = follow.follow

    def kept(*arguments: Any) -> Steps[tuple[np.ndarray, np.ndarray]]:
        followed = yield from real(*arguments)
        found.append(followed[1])
        return followed

    monkeypatch.setattr(follow, "follow", kept)
    return found


def test_a_moved_object_bakes_what_is_near_and_in_its_shadow(bounds: list[np.ndarray]) -> None:
    item = build_corridor()
    source, first = baked()
    assert notes(first)["whole_because"] == "there is no earlier bake" and notes(first)["texels_baked"] == 1.0
    item.location.x += 0.5
    source, second = baked()
    _, full = baked(incremental=False)
    x, old, new, right = along(source), means(source, first), means(source, second), means(source, full)
    white = np.quantile(right, 0.995)
    change = np.abs(right - old)
    changed = change > TOLERANCE * white
    assert changed.any() and (new[changed] != old[changed]).all(), "all that changed is baked again"
    assert (change <= bounds[0] + 0.1 * TOLERANCE * white)[new == old].all(), "no less is counted than changes"
    far = x > 0.6 * LENGTH
    np.testing.assert_array_equal(new[far], old[far])
    assert np.abs(new - right)[new == old].max() < TOLERANCE * white
    said = notes(second)
    assert 0.02 < said["texels_baked"] < 0.6 and "whole_because" not in said
    assert said["triangles_baked"] < 0.6 * said["triangles"] == 0.6 * len(x)
    assert full.notes == {}


def test_a_scene_that_did_not_change_bakes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    build_corridor()
    _, first = baked(samples=1)
    monkeypatch.setattr(baker, "bake_now", lambda *_: pytest.fail("nothing is to be baked"))
    _, second = baked(samples=1)
    np.testing.assert_array_equal(second.texels, first.texels)
    assert notes(second)["pages_baked"] == 0 and notes(second)["pages_kept"] == notes(second)["pages"]


def test_in_the_open_what_stays_is_right_and_is_most_of_it() -> None:
    """A post in the sun beside a wall, under a gray sky: its shadows and what is near are baked again."""
    scene = bpy.context.scene
    matt = principled("Matt", (0.5, 0.5, 0.5), roughness=1.0, specular=0.0)
    ground = place(scene.collection, "Ground", box((-8.0, -8.0, -0.1), (8.0, 8.0, 0.0)), matt)
    wall = place(scene.collection, "Wall", box((-8.0, 2.0, 0.0), (8.0, 2.3, 2.0)), matt)
    for item in (ground, wall):
        subdivide(item, 5)
    post = place(scene.collection, "Post", box((-0.2, -0.2, 0.0), (0.2, 0.2, 1.2)), matt)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.6, 0.2, 0.0)
    scene.collection.objects.link(sun)
    scene.world = bpy.data.worlds.new("Gray")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.3, 0.3, 0.3, 1.0)
    source, first = baked(samples=64)
    post.location.x += 0.5
    source, second = baked(samples=64)
    _, full = baked(incremental=False, samples=64)
    old, new, right = means(source, first), means(source, second), means(source, full)
    white = np.quantile(right, 0.995)
    changed = np.abs(right - old) > TOLERANCE * white
    assert changed.sum() > 10 and (new[changed] != old[changed]).all(), "all that changed is baked again"
    assert np.abs(new - right)[new == old].max() < TOLERANCE * white
    assert 0.0 < notes(second)["texels_baked"] < 0.3 and "whole_because" not in notes(second)


def test_suns_and_emitters_take_no_more_light_away_than_they_give() -> None:
    """A lit plane shows what is counted for its sun; a lantern counts by its material and its surface."""
    scene = bpy.context.scene
    place(scene.collection, "Ground", box((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0)), principled("Matt", (0.5, 0.5, 0.5)))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.color, scene.world = 3.0, (1.0, 0.5, 0.2), None
    scene.collection.objects.link(sun)
    source, atlas = baked(incremental=False, samples=4)
    items = {item["name"]: item for item in scene_items(bpy.context.evaluated_depsgraph_get(), False)["items"]}
    told = albedo_of(source.materials[0]) * items["Sun"]["at_most"] / np.pi
    assert told == pytest.approx(atlas.texels[:, 0].max(), rel=0.02) and "intensity" not in items["Sun"]
    glow = principled("Glow", (0.0, 0.0, 0.0))
    lantern = place(scene.collection, "Lantern", box((0.0, 0.0, 1.0), (1.0, 1.0, 2.0)), glow)
    inputs = glow.node_tree.nodes["Principled BSDF"].inputs
    inputs["Emission Color"].default_value, inputs["Emission Strength"].default_value = (1.0, 1.0, 1.0, 1.0), 2.0
    assert emission_at_most(lantern) == pytest.approx(2.0)
    bpy.context.view_layer.update()
    items = {item["name"]: item for item in scene_items(bpy.context.evaluated_depsgraph_get(), False)["items"]}
    assert items["Lantern"]["at_most"] == pytest.approx(12.0)
    noise = glow.node_tree.nodes.new("ShaderNodeTexNoise")
    glow.node_tree.links.new(noise.outputs[0], inputs["Emission Strength"])
    assert emission_at_most(lantern) is None


def test_many_small_errors_do_not_add_up() -> None:
    """What stays keeps count of what it may lack: after enough moves all of the corridor was baked again."""
    item = build_corridor(2)
    source, first = baked(samples=1, tolerance=0.06)
    old = means(source, first)
    for _ in range(6):
        item.location.x += 0.05
        source, last = baked(samples=1, tolerance=0.06)
    one = notes(last)["triangles_baked"]
    assert one < notes(last)["triangles"]
    middle = (along(source) > 5) & (along(source) < 9)
    once = means(source, first)[middle] == old[middle]
    assert once.all() and (means(source, last)[middle] != old[middle]).any()


def test_a_moved_lamp_bakes_what_it_lit_and_lights() -> None:
    build_corridor()
    source, first = baked(samples=1, tolerance=0.04)
    bpy.data.objects["Lamp 0"].location.x -= 0.5
    source, second = baked(samples=1, tolerance=0.04)
    same = means(source, first) == means(source, second)
    same &= means(source, first) > 0.0  # the box's underside is dark before and after
    assert not same[along(source) < 4].any() and notes(second)["texels_baked"] < 1.0
    assert same[along(source) > LENGTH - 3].any()


def test_what_is_not_followed_bakes_the_whole_scene_and_says_why() -> None:
    build_corridor(1)
    baked(samples=1)
    lamp = bpy.data.objects["Lamp 0"].data
    lamp.type = "SUN"
    _, atlas = baked(samples=1)
    assert notes(atlas)["whole_because"] == "the light of 'Lamp 0' is not followed"
    bpy.context.scene.cycles.max_bounces += 1
    _, atlas = baked(samples=1)
    assert notes(atlas)["whole_because"] == "the world or render settings changed"
    shining = bpy.data.objects[BOX]
    node = shining.data.materials[0].node_tree.nodes["Principled BSDF"]
    node.inputs["Emission Strength"].default_value = 2.0
    _, atlas = baked(samples=1)
    assert "is not followed" in notes(atlas)["whole_because"]
    assert notes(atlas)["texels_baked"] == 1.0


def test_objects_that_come_and_go_and_look_otherwise() -> None:
    item = build_corridor()
    source, first = baked(samples=4)
    item.hide_render = True
    bpy.context.view_layer.update()
    source, gone = baked(samples=4)
    assert source.triangle_count == len(gone.charts.page) and 0.0 < notes(gone)["texels_baked"] < 0.6
    item.hide_render = False
    source, back = baked(samples=4)
    assert notes(back)["texels_baked"] < 0.6
    _, full = baked(incremental=False, samples=4)
    again = means(source, back)
    kept = again == means(source, first)
    white = np.quantile(means(source, full), 0.995)
    assert kept.any() and np.abs(again - means(source, full))[kept].max() < TOLERANCE * white
    other = item.data.materials[0].copy()
    other.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.1, 0.1, 1.0)
    item.data.materials[0] = other
    source, painted = baked(samples=4)
    names = [name for part in source.parts for name in part.objects for _ in range(len(part.mesh))]
    mine = np.array(names) == BOX
    assert (means(source, painted)[mine] != again[mine]).any() and notes(painted)["texels_baked"] < 0.6


def test_cameras_and_empties_change_nothing_and_skies_are_known() -> None:
    build_corridor(1)
    scene = bpy.context.scene
    graph = bpy.context.evaluated_depsgraph_get()
    before = scene_items(graph, False)
    scene.collection.objects.link(bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye")))
    bpy.context.view_layer.update()
    change = change_of(before, scene_items(bpy.context.evaluated_depsgraph_get(), False))
    assert len(change.boxes) == 0 and not change.lit
    world = bpy.data.worlds.new("Sky")
    if not world.use_nodes:
        world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = 0.5
    assert sky_luminance(world) == pytest.approx(0.5) and sky_luminance(None) == 0.0
    ramp = world.node_tree.nodes.new("ShaderNodeValToRGB")
    world.node_tree.links.new(ramp.outputs[0], background.inputs["Color"])
    ramp.color_ramp.elements[1].color = (0.4, 0.4, 0.4, 1.0)
    assert sky_luminance(world) == pytest.approx(0.2)
    sky = world.node_tree.nodes.new("ShaderNodeTexSky")
    world.node_tree.links.new(sky.outputs[0], background.inputs["Color"])
    assert sky_luminance(world) is None
