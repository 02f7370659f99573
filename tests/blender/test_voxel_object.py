# SPDX-License-Identifier: GPL-3.0-or-later
"""Show Voxels: the object in the scene, which is not read, lit or watched itself."""

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.session import results
from patchnet.operators.voxel_object import NAME
from patchnet.patchnet_addon.octree.voxel_cloud import voxel_cloud, voxel_counts
from patchnet.tests.blender.job_scene import build, render_by_cycles
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.training.commands.lab.furnished.models import vertices_of


@pytest.fixture(autouse=True)
def scene(scene: bpy.types.Scene) -> bpy.types.Scene:
    bpy.ops.patchnet.voxelize(depth=6)
    bpy.ops.patchnet.bake_light(light="two-lights")
    return scene


def shown() -> bpy.types.Object:
    (item,) = (each for each in bpy.context.scene.objects if each.name.startswith(NAME))
    return item


def attribute(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    values = np.empty(len(mesh.vertices), np.float32)
    mesh.attributes[name].data.foreach_get("value", values)
    return values


def evaluated(item: bpy.types.Object) -> bpy.types.Object:
    return item.evaluated_get(bpy.context.evaluated_depsgraph_get())


def set_input(item: bpy.types.Object, name: str, value: object) -> None:
    """Set an input of the modifier as its panel does."""
    modifier = item.modifiers[NAME]
    items = modifier.node_group.interface.items_tree
    key = next(each.identifier for each in items if each.name == name and each.in_out == "INPUT")
    if getattr(modifier, "properties", None) is None:  # Blender 4.5
        modifier[key] = value
    else:
        getattr(modifier.properties.inputs, key).value = value
    item.update_tag()
    bpy.context.view_layer.update()


def test_one_vertex_a_voxel(scene: bpy.types.Scene) -> None:
    assert bpy.ops.patchnet.show_voxels(level=4) == {"FINISHED"}
    cloud, mesh = voxel_cloud(results.voxels_of(scene).octree, 4), shown().data
    np.testing.assert_allclose(vertices_of(mesh), cloud.centres_world, atol=1e-6)
    np.testing.assert_array_equal(attribute(mesh, "luminance"), cloud.luminance)
    np.testing.assert_array_equal(attribute(mesh, "side"), cloud.side_world)


def test_cubes_fill_the_voxels(scene: bpy.types.Scene) -> None:
    bpy.ops.patchnet.show_voxels(level=4)
    cloud, item = voxel_cloud(results.voxels_of(scene).octree, 4), shown()
    mesh = evaluated(item).data
    assert len(mesh.polygons) == 6 * len(cloud)
    assert mesh.attributes.active_color_name == "luminance_color"
    corners = np.concatenate([cloud.centres_world + sign * cloud.side_world[:, None] / 2 for sign in (-1, 1)])
    assert vertices_of(mesh).min(axis=0) == pytest.approx(corners.min(axis=0), abs=1e-5)
    assert vertices_of(mesh).max(axis=0) == pytest.approx(corners.max(axis=0), abs=1e-5)
    volume = sum(polygon.area for polygon in mesh.polygons) / 6
    assert volume == pytest.approx((cloud.side_world.astype(float) ** 2).sum(), rel=1e-4)
    set_input(item, "Size", 0.5)
    assert sum(polygon.area for polygon in evaluated(item).data.polygons) / 6 == pytest.approx(volume / 4, rel=1e-4)


def test_solid_shading_shows_their_color(scene: bpy.types.Scene) -> None:
    """Viewports in Solid shading take colors from attributes from then on; those in another shading stay."""
    bpy.ops.patchnet.voxelize(depth=4)
    (window,) = bpy.context.window_manager.windows
    spaces = [area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D"]
    assert spaces
    for shading, color in (("WIREFRAME", "MATERIAL"), ("SOLID", "VERTEX")):
        for space in spaces:
            space.shading.type = "SOLID"
            space.shading.color_type, space.shading.type = "MATERIAL", shading
        with bpy.context.temp_override(window=window):
            bpy.ops.patchnet.show_voxels()
        for space in spaces:
            space.shading.type = "SOLID"
            assert space.shading.color_type == color
    mesh = evaluated(shown()).data
    assert mesh.color_attributes.active_color.name == mesh.attributes.active_color_name == "luminance_color"


def picture(path: Path) -> np.ndarray:
    """A small Cycles picture (H, W, 4), linear, of the voxels alone."""
    scene, item = bpy.context.scene, shown()
    for other in scene.objects:
        other.hide_render = other.type == "MESH" and other != item
    return render_by_cycles(path, (32, 24), 1)


def test_pictures_show_colour(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Every pixel of one sample shows exactly one voxel, whatever light there is in the scene."""
    result = results.voxels_of(scene)
    chroma = np.random.default_rng(0).integers(30, 128, (result.octree.node_count, 2)).astype(np.uint8)
    results.put(scene, replace(result, octree=replace(result.octree, chroma=chroma)))
    bpy.ops.patchnet.show_voxels(level=4)
    cloud = voxel_cloud(results.voxels_of(scene).octree, 4)
    assert np.ptp(cloud.color, axis=1).max() > 0.2
    pixels = picture(tmp_path / "picture.exr")
    seen = pixels[pixels[..., 3] > 0.999][:, :3]
    assert len(seen) > 150
    assert np.abs(seen[:, None] - cloud.color).max(axis=2).min(axis=1).max() < 1e-5


def test_it_is_replaced_and_a_renamed_one_is_kept(scene: bpy.types.Scene) -> None:
    selected, active = bpy.context.selected_objects, bpy.context.object
    bpy.ops.patchnet.show_voxels(level=5)
    first, counts = shown(), voxel_counts(results.voxels_of(scene).octree)
    assert bpy.context.selected_objects == selected and bpy.context.object == active
    assert first.hide_render and not first.hide_select and first.visible_get()
    before = {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "materials", "node_groups")}
    first.hide_render, first.location.x = False, 1.0
    bpy.ops.patchnet.show_voxels(level=3)
    assert shown() == first and len(first.data.vertices) == counts[3]
    assert first.location.x == 0.0 and not first.hide_render
    assert before == {name: len(getattr(bpy.data, name)) for name in before}
    first.name = "Kept"
    bpy.ops.patchnet.show_voxels(level=4)
    assert shown() != first and len(first.data.vertices) == counts[3]
    bpy.ops.patchnet.clear_results()
    assert len(shown().data.vertices) == counts[4]


def test_finest_level_within_the_limit(scene: bpy.types.Scene, capfd: pytest.CaptureFixture[str]) -> None:
    counts = voxel_counts(results.voxels_of(scene).octree)
    bpy.ops.patchnet.show_voxels()
    assert len(shown().data.vertices) == counts[6]
    bpy.ops.patchnet.show_voxels(limit=int(counts[5]) - 1)
    assert len(shown().data.vertices) == counts[4]
    bpy.ops.patchnet.show_voxels(level=6, limit=int(counts[5]))
    assert len(shown().data.vertices) == counts[5]
    text = capfd.readouterr().out
    assert f"Warning: {counts[5]:,} voxels of level 5" in text
    assert f"level 6 has {counts[6]:,}, more than the limit of {counts[5]:,}" in text
    scene.patchnet.level = 2
    bpy.ops.patchnet.show_voxels()
    assert len(shown().data.vertices) == counts[2]
    with pytest.raises(RuntimeError, match="Level 9 is outside 0 to 6"):
        bpy.ops.patchnet.show_voxels(level=9)


def test_shown_voxels_are_no_part_of_the_scene(scene: bpy.types.Scene) -> None:
    before = results.voxels_of(scene).octree
    bpy.ops.patchnet.show_voxels()
    item = shown()
    bpy.context.view_layer.update()
    assert results.voxels_of(scene).stale == set()
    item.location.z = 5.0
    item.active_material.node_tree.nodes["Emission"].inputs["Strength"].default_value = 9.0
    bpy.context.view_layer.update()
    assert results.voxels_of(scene).stale == set()
    item.hide_render = False  # worst case: rendered and selected
    item.select_set(True)
    bpy.ops.patchnet.voxelize(depth=6, scope="SELECTED")  # the slab is selected too
    assert results.voxels_of(scene).octree.area_world[0] == pytest.approx(2 * 2 * 2 + 4 * 2 * 0.1, rel=1e-4)
    bpy.ops.patchnet.voxelize(depth=6)
    bpy.ops.patchnet.bake_light(light="two-lights")
    np.testing.assert_array_equal(results.voxels_of(scene).octree.luminance, before.luminance)


def test_shown_voxels_are_no_light_of_a_dark_scene() -> None:
    from patchnet.operators.cycles.daylight import has_light

    build(light=False)
    bpy.ops.patchnet.voxelize(depth=4)
    bpy.ops.patchnet.show_voxels()
    shown().hide_render = False
    assert not has_light(bpy.context.evaluated_depsgraph_get())


def test_refusals_change_nothing(scene: bpy.types.Scene) -> None:
    bpy.ops.patchnet.show_voxels(level=3)
    bpy.context.view_layer.objects.active = shown()
    bpy.ops.object.mode_set(mode="EDIT")
    before = scene_snapshot()
    with pytest.raises(RuntimeError, match="Object Mode only"):
        bpy.ops.patchnet.show_voxels(level=2)
    assert_unchanged(before)
    bpy.ops.object.mode_set(mode="OBJECT")
    build()
    with pytest.raises(RuntimeError, match="no voxels yet"):
        bpy.ops.patchnet.show_voxels()
