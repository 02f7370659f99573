# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of a scene are those of Blender's evaluated render meshes."""

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from patchnet.operators.scene.read import scene_surface
from patchnet.patchnet_addon.runtime.errors import EmptySelectionError, GeometryError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.scene_mesh import SceneMesh
from patchnet.tests.blender.objects import collection_instance, cuboid, group, link, mesh, moved_to, read
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("empty_scene")


def cube(name: str = "Cube") -> bpy.types.Object:
    return cuboid(name, (0.0,) * 3, (1.0,) * 3)


def corners(source: SceneMesh) -> np.ndarray:
    return np.concatenate([batch.corners_world for batch in source.batches()])


def area(points: np.ndarray) -> float:
    return 0.5 * float(np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1).sum())


def volume(points: np.ndarray) -> float:
    """Signed volume that triangles (T, 3, 3) enclose; positive if their normals point outwards."""
    return float(np.linalg.det(points).sum()) / 6.0


@pytest.mark.parametrize("scale", [(2, 3, 0.5), (-2, -1, -3), (1, -1, -1)])
def test_transforms_keep_normals_outside(scale: tuple[float, float, float]) -> None:
    item = cube()
    item.matrix_world = (
        Matrix.Translation((3, -2, 1)) @ Euler((0.3, 0.2, 1)).to_matrix().to_4x4() @ Matrix.Diagonal((*scale, 1))
    )
    source = read()
    points = corners(source)
    assert source.triangle_count == len(points) == 12
    assert volume(points - points.mean(axis=(0, 1))) == pytest.approx(abs(np.prod(scale)), rel=1e-5)
    expected = np.array([item.matrix_world @ vertex.co for vertex in item.data.vertices])
    np.testing.assert_allclose(source.bounds_world, [expected.min(axis=0), expected.max(axis=0)], atol=1e-5)


def test_modifiers_with_render_settings_and_scene_unchanged() -> None:
    item = cube()
    array = item.modifiers.new("Array", "ARRAY")
    array.count, array.show_viewport = 3, False
    subdivision = item.modifiers.new("Subdivision", "SUBSURF")
    subdivision.subdivision_type, subdivision.levels, subdivision.render_levels = "SIMPLE", 0, 2
    driver = subdivision.driver_add("levels")
    driver.driver.expression = "0"
    bpy.context.view_layer.update()
    before = scene_snapshot()
    source = read()
    assert source.triangle_count == 12 * 3 * 16
    assert_unchanged(before)
    assert not driver.mute
    assert len(item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons) == 6


def test_curve_text_surface_and_metaball() -> None:
    curve = bpy.data.curves.new("Tube", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[0].co, spline.points[1].co = (0, 0, 0, 1), (0, 0, 4, 1)
    link(bpy.data.objects.new("Tube", curve))
    tube = read()
    assert area(corners(tube)) == pytest.approx(2 * np.pi * 0.1 * 4, rel=0.05)
    text = bpy.data.curves.new("Text", "FONT")
    text.body = "I"
    link(bpy.data.objects.new("Text", text)).location = (10, 0, 0)
    with_text = read()
    assert with_text.triangle_count > tube.triangle_count
    ball = bpy.data.metaballs.new("Ball")
    ball.resolution = ball.render_resolution = 0.1
    element = ball.elements.new()
    element.radius = 1.0
    link(bpy.data.objects.new("Ball", ball)).location = (20, 0, 0)
    assert read().bounds_world[1, 0] > 20.0
    assert {name for part in read().parts for name in part.objects} == {"Tube", "Text", "Ball"}


def test_collection_instances_belong_to_their_instancer() -> None:
    group = moved_to(bpy.data.collections.new("Group"), cube())
    for number in range(3):
        collection_instance(group, f"Empty {number}", (3 * number, 0, 0)).select_set(number == 1)
    source = read()
    assert (source.triangle_count, len(source.parts)) == (36, 1)
    selected = read("SELECTED")
    assert selected.triangle_count == 12
    np.testing.assert_allclose(selected.bounds_world, [[3, 0, 0], [4, 1, 1]], atol=1e-6)


def test_scope_follows_visibility() -> None:
    shown, hidden, unrendered, excluded, invisible, disabled = (cube(name) for name in "ABCDEF")
    hidden.hide_set(True)
    unrendered.hide_render = True
    invisible.visible_camera = False
    for name, item in (("Excluded", excluded), ("Disabled", disabled)):
        group(name, item)
    bpy.data.collections["Disabled"].hide_render = True
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    assert {name for part in read().parts for name in part.objects} == {"A", "B"}
    shown.hide_render = hidden.hide_render = True
    with pytest.raises(EmptySelectionError, match="No visible object"):
        read()


def test_material_slots_and_uvs() -> None:
    places = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
    item = link(mesh("Quads", places, [(0, 1, 2, 3), (1, 4, 5, 2)]))
    materials = [bpy.data.materials.new(name) for name in ("One", "Two")]
    for material in materials:
        item.data.materials.append(material)
    item.data.polygons[1].material_index = 1
    item.data.uv_layers.new(name="Other")
    layer = item.data.uv_layers.new(name="Shown")
    layer.active_render = True
    for loop, value in zip(item.data.loops, layer.uv, strict=True):
        value.vector = item.data.vertices[loop.vertex_index].co.xy * 0.5
    copy = link(bpy.data.objects.new("Copy", item.data))
    copy.location = (0, 0, 1)
    copy.scale = (-1, 1, 1)
    copy.material_slots[0].link = "OBJECT"
    copy.material_slots[0].material = bpy.data.materials.new("Own")
    source = read()
    batch = next(source.batches())
    names = [source.materials[index].name for index in batch.materials]
    assert sorted(names) == ["One", "One", "Own", "Own", "Two", "Two", "Two", "Two"]
    np.testing.assert_allclose(batch.uvs, np.abs(batch.corners_world[..., :2]) * 0.5, atol=1e-6)
    centre = np.abs(batch.corners_world.mean(axis=1)[:, 0])
    assert [name == "Two" for name in names] == [bool(x > 1) for x in centre]


def test_shading_normals_follow_the_transform() -> None:
    item = cube()
    item.data.shade_smooth()
    item.scale = (-2, 1, 0.5)
    item.rotation_euler = (0.4, 0.1, 0.7)
    source = read()
    (run,) = next(source.runs())
    normals = run.normals_world()
    assert normals is not None
    # A smooth cube's vertex normals point along its diagonals; normals turn with the inverse transpose.
    inverse = np.linalg.inv(np.array(item.matrix_world.to_3x3())).T
    local = (
        np.array(item.matrix_world.inverted()) @ np.append(run.corners_world().reshape(-1, 3), np.ones((36, 1)), 1).T
    )
    expected = (local[:3].T - 0.5) @ inverse.T
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals.reshape(-1, 3), expected, atol=2e-3)


def test_bad_input() -> None:
    with pytest.raises(EmptySelectionError, match="No visible object has a surface"):
        read()
    item = cube("Broken")
    with pytest.raises(EmptySelectionError, match="No selected object has a surface"):
        read("SELECTED")
    for value in (np.nan, np.inf):
        item.data.vertices.foreach_set("co", [value] * 24)  # one by one they are clamped
        with pytest.raises(EmptySelectionError, match=r"vertices that are not finite .*are left out: repair 'Broken'"):
            read()
    for vertex in item.data.vertices:
        vertex.co = (1, 2, 3)
    with pytest.raises(GeometryError, match="'Broken' has no area"):
        read()
    item.hide_render = True
    link(mesh("Points", [(0, 0, 0), (1, 0, 0)], []))
    with pytest.raises(EmptySelectionError):
        read()


@pytest.mark.parametrize("ends", ["read", "stopped"])
def test_edits_between_steps_of_the_reading_change_nothing_of_it(ends: str) -> None:
    items = [cuboid(name, (low, 0.0, 0.0), (low + 1.0, 1.0, 1.0)) for name, low in (("Moved", 0.0), ("Gone", 2.0))]
    instances = collection_instance(group("Group", items[0]), location=(0.0, 3.0, 0.0))
    expected = corners(read())
    reading = scene_surface(bpy.context.evaluated_depsgraph_get())
    next(reading)
    copies = [mesh for mesh in bpy.data.meshes if mesh.is_runtime_data]
    assert len(copies) == 2
    items[0].data.transform(Matrix.Translation((0.0, 0.0, 9.0)))
    bpy.data.objects.remove(instances)
    bpy.data.meshes.remove(items[1].data)  # and its object
    bpy.context.view_layer.update()
    if ends == "read":
        np.testing.assert_array_equal(corners(drain(reading)), expected)
    reading.close()
    assert list(bpy.data.meshes) == [items[0].data]
