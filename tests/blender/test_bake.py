# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked light against light that can be computed by hand, and the scene as it was before."""

import bpy
import numpy as np
import pytest
from mathutils import Euler, Vector

from patchnet.operators.cycles.bake import bake, bake_luminance, bake_scene, baker
from patchnet.operators.cycles.bake.bake_call import BakeTarget
from patchnet.operators.scene.read import read_scene
from patchnet.operators.scene.scene_mesh import SceneMesh
from patchnet.operators.scene_access.devices import gpu_is_enabled
from patchnet.operators.settings.groups import LightSettings
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.atlas_shade import atlas_shade
from patchnet.patchnet_addon.lightmap.chart_lookup import texel_owners
from patchnet.patchnet_addon.runtime.errors import SceneError, SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments
from patchnet.tests.blender.light_scene import CUBE_FACES, SQUARE
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("empty_scene")


def diffuse(color: tuple[float, float, float] = (0.5, 0.5, 0.5), emission: float = 0.0) -> bpy.types.Material:
    """Diffuse plus emission."""
    material = bpy.data.materials.new("Diffuse")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    nodes = [tree.nodes.new(f"Shader{name}") for name in ("NodeBsdfDiffuse", "NodeEmission", "NodeAddShader")]
    nodes[0].inputs["Color"].default_value = (*color, 1.0)
    nodes[1].inputs["Strength"].default_value = emission
    for index in range(2):
        tree.links.new(nodes[index].outputs[0], nodes[2].inputs[index])
    tree.links.new(nodes[2].outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def mesh_object(name: str, vertices: list, faces: list, material: bpy.types.Material | None = None) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    if material:
        mesh.materials.append(material)
    item = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(item)
    return item


def square(name: str, material: bpy.types.Material | None = None, up: bool = True) -> bpy.types.Object:
    return mesh_object(name, SQUARE, [(0, 1, 2, 3) if up else (3, 2, 1, 0)], material)


def cube(material: bpy.types.Material | None = None, inside_out: bool = False) -> bpy.types.Object:
    vertices = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    return mesh_object("Cube", vertices, [face[::-1] if inside_out else face for face in CUBE_FACES], material)


def sun(strength: float, rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    light = bpy.data.lights.new("Sun", "SUN")
    light.energy, light.angle = strength, 0.0
    item = bpy.data.objects.new("Sun", light)
    item.rotation_euler = rotation
    bpy.context.scene.collection.objects.link(item)
    return item


def baked(texel_world: float = 0.25, samples: int = 16, both_sides: bool = False) -> tuple[SceneMesh, Atlas]:
    bpy.context.view_layer.update()
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    light = LightSettings(samples=samples, both_sides=both_sides, color=False)
    return source, drain(bake_luminance(bpy.context, source, texel_world, light))


def shaded(source: SceneMesh, atlas: Atlas, grid: int = 6) -> dict[str, np.ndarray]:
    """Luminance at the centres of grid^2 equal parts of each triangle, by object: (triangles, points)."""
    shade = atlas_shade(atlas, source)
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(grid) for j in range(grid - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(grid) for j in range(grid - i - 1)]
    points = np.array(upright + turned, np.float32) / grid
    names = [name for part in source.parts for name in part.objects for _ in range(len(part.mesh))]
    result: dict[str, list[np.ndarray]] = {}
    for batch in source.batches():
        for triangle in range(len(batch)):
            count = len(points)
            fragments = Fragments(
                np.zeros(count, np.uint64), np.full(count, triangle, np.int32), points, np.full(count, 1e-4)
            )
            values, _ = shade(batch, fragments)
            result.setdefault(names[batch.first_triangle + triangle], []).append(values)
    return {name: np.array(values) for name, values in result.items()}


def test_closed_box_under_the_sun_is_lambertian() -> None:
    cube(diffuse((0.5, 0.5, 0.5))).data.shade_flat()
    lamp = sun(3.0, (0.5, 0.3, 0.0))
    source, atlas = baked()
    towards = np.array(lamp.matrix_world.to_3x3() @ Vector((0, 0, 1)))
    (batch,) = source.batches()
    normals = np.cross(
        batch.corners_world[:, 1] - batch.corners_world[:, 0], batch.corners_world[:, 2] - batch.corners_world[:, 0]
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    expected = np.maximum(normals @ towards, 0.0) * 3.0 * 0.5 / np.pi
    values = shaded(source, atlas)["Cube"]
    np.testing.assert_allclose(values, np.broadcast_to(expected[:, None], values.shape), atol=1e-3)


def test_sides_of_sheets() -> None:
    material = diffuse((0.5, 0.5, 0.5))
    sun(3.0)
    for index, name in enumerate(("Up", "Down")):
        square(name, material, up=name == "Up").location = (10 * index, 0, 0)
    lit = 3.0 * 0.5 / np.pi
    values = shaded(*baked())
    assert values["Up"].mean() == pytest.approx(lit, rel=1e-3), "the dark side of a sheet does not count"
    assert values["Down"].mean() == pytest.approx(lit, rel=1e-3), "even if it is the front"
    sun(1.0, (np.pi, 0.0, 0.0))
    values = shaded(*baked(both_sides=True))
    for name in ("Up", "Down"):
        assert values[name].mean() == pytest.approx(lit * (1.0 + 1.0 / 3.0) / 2.0, rel=1e-3), (
            "the mean of two lit sides"
        )


@pytest.mark.parametrize("by_material", [False, True])
def test_fronts_alone(by_material: bool) -> None:
    material = diffuse((0.5, 0.5, 0.5))
    material.use_backface_culling = by_material
    lamps = [sun(3.0), sun(1.0, (np.pi, 0.0, 0.0))]
    for index, name in enumerate(("Up", "Down")):
        square(name, material, up=name == "Up").location = (10 * index, 0, 0)
    values = shaded(*baked(both_sides=by_material))
    assert values["Up"].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=1e-3)
    assert values["Down"].mean() == pytest.approx(1.0 * 0.5 / np.pi, rel=1e-3)
    bpy.data.objects.remove(lamps[1])
    values = shaded(*baked(both_sides=by_material))
    assert values["Down"].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=1e-3), "a dark front is no front"


@pytest.mark.parametrize(("strength", "seen"), [(0.003, 3.0), (0.3, 0.3)])
def test_normals_that_point_into_a_building(strength: float, seen: float) -> None:
    """A front that gets next to no light is enclosed there, although a little finds its way in; shade is shade."""
    material = diffuse((0.5, 0.5, 0.5))
    sun(3.0), sun(strength, (np.pi, 0.0, 0.0))
    for index, name in enumerate(("Up", "Down")):
        square(name, material, up=name == "Up").location = (10 * index, 0, 0)
    values = shaded(*baked())
    assert values["Up"].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=1e-3)
    assert values["Down"].mean() == pytest.approx(seen * 0.5 / np.pi, rel=1e-3)


def test_closed_boxes_that_are_lit_from_inside() -> None:
    """The inner side counts where nothing shines outside. A sheet beside it keeps the mean of its sides."""
    cube(diffuse((0.5, 0.5, 0.5)))
    lamp = bpy.data.lights.new("Lamp", "POINT")
    lamp.energy, lamp.shadow_soft_size = 40.0, 0.01
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Lamp", lamp))
    cube(diffuse((0.5, 0.5, 0.5))).location.x = 20
    material = diffuse((0.0, 0.0, 0.0))
    tree = material.node_tree
    strength = tree.nodes.new("ShaderNodeMath")
    strength.operation = "MULTIPLY_ADD"
    strength.inputs[1].default_value, strength.inputs[2].default_value = 0.4, 0.4
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], strength.inputs[0])
    tree.links.new(strength.outputs[0], tree.nodes["Emission"].inputs["Strength"])
    sheet = square("Sheet", material)
    sheet.location.x, sheet.scale = 20, (0.5, 0.5, 0.5)
    bpy.context.scene.cycles.diffuse_bounces = 0
    values = shaded(*baked(0.25, 64, both_sides=True))
    # The lamp's 40 W fall on 24 square metres.
    assert values["Cube"].mean() == pytest.approx(40.0 / 24.0 * 0.5 / np.pi, rel=0.02)
    assert values["Cube.001"].min() > 0.0
    assert values["Sheet"].mean() == pytest.approx(0.6, rel=1e-3)


def test_furnace() -> None:
    """In a closed room of albedo a where everything emits e, light is e / (1 - a), after all bounces."""
    cube(diffuse((0.5, 0.5, 0.5), emission=0.3), inside_out=True)
    cycles = bpy.context.scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = 24
    values = shaded(*baked(0.5, 64))["Cube"]
    assert values.mean() == pytest.approx(0.6, rel=0.02)
    assert values.std() < 0.05


def test_light_bounces_off_a_wall() -> None:
    square("Floor", diffuse((0.8, 0.8, 0.8)))
    wall = square("Wall", diffuse((0.8, 0.0, 0.0)))
    wall.rotation_euler, wall.location = (0, np.pi / 2, 0), (-1.0, 0, 1.0)
    sun(3.0, (0.0, 0.8, 0.0))
    bpy.context.scene.cycles.diffuse_bounces = 1
    with_red = shaded(*baked(0.25, 64))["Floor"]
    wall.data.materials[0] = diffuse((0.0, 0.0, 0.0))
    without = shaded(*baked(0.25, 64))["Floor"]
    direct = 3.0 * np.cos(0.8) * 0.8 / np.pi
    assert without.mean() == pytest.approx(direct, rel=1e-3)
    # The wall's radiosity over the floor: form factor of two adjacent squares is 0.2.
    bounced = 0.2 * 3.0 * np.sin(0.8) * 0.8 * 0.2126 * 0.8 / np.pi
    assert with_red.mean() - direct == pytest.approx(bounced, rel=0.03)


def test_emission_and_mixed_alpha() -> None:
    square("Lamp", diffuse((0.0, 0.0, 0.0), emission=2.5)).location = (50, 0, 0)
    material = bpy.data.materials.new("Glassy")
    if material.node_tree is None:
        material.use_nodes = True
    principled = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    principled.inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    principled.inputs["Specular IOR Level"].default_value = 0.0
    principled.inputs["Alpha"].default_value = 0.75
    square("Pane", material)
    sun(3.0)
    source, atlas = baked()
    values = shaded(source, atlas)
    assert values["Lamp"].mean() == pytest.approx(2.5, rel=1e-3)
    assert values["Pane"].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=5e-3), "opacity must be divided out"
    assert atlas.texels[:, 1].max() <= 1.0


def test_instances_are_lit_where_they_stand() -> None:
    material = diffuse((0.5, 0.5, 0.5))
    first = square("In the sun", material)
    second = bpy.data.objects.new("In the shade", first.data)
    bpy.context.scene.collection.objects.link(second)
    second.location, second.scale = (10, 0, 0), (-1, 1, 1)
    roof = square("Roof", diffuse((0.0, 0.0, 0.0)))
    roof.location, roof.scale = (10, 0, 0.5), (50, 50, 1)
    roof.location.x = 10 + 50 - 2
    sun(3.0)
    values = shaded(*baked())
    assert values["In the sun"].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=1e-3)
    assert values["In the shade"].max() == pytest.approx(0.0, abs=1e-4)


def test_textures_and_unselected_occluders() -> None:
    """Texture coordinates survive, and what is not baked still casts its shadow."""
    item = square("Floor", diffuse())
    item.data.uv_layers.new(name="Any name")
    item.data.uv_layers["Any name"].uv.foreach_set("vector", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32))
    image = bpy.data.images.new("Halves", 2, 1, float_buffer=True)
    image.pixels.foreach_set(np.array([0.0, 0.0, 0.0, 1.0, 0.8, 0.8, 0.8, 1.0], np.float32))
    tree = item.data.materials[0].node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation, texture.extension = image, "Closest", "EXTEND"
    tree.links.new(texture.outputs["Color"], tree.nodes["Diffuse BSDF"].inputs["Color"])
    cover = square("Cover", diffuse((0.0, 0.0, 0.0)))
    cover.location, cover.scale = (0, 1.5, 1), (5, 1.5, 1)  # over y > 0
    sun(3.0)
    bpy.context.view_layer.update()
    item.select_set(True)
    cover.select_set(False)
    source = read_scene(bpy.context.evaluated_depsgraph_get(), "SELECTED")
    atlas = drain(bake_luminance(bpy.context, source, 0.1, LightSettings(samples=16, color=False)))
    shade = atlas_shade(atlas, source)
    (batch,) = source.batches()
    for triangle in range(2):
        points = np.array([(0.2, 0.1), (0.1, 0.2), (0.4, 0.3), (0.3, 0.4), (0.1, 0.6), (0.6, 0.1)], np.float32)
        corners = batch.corners_world[triangle]
        world = corners[0] + points @ (corners[1:] - corners[0])
        count = len(points)
        fragments = Fragments(
            np.zeros(count, np.uint64), np.full(count, triangle, np.int32), points, np.full(count, 1e-3)
        )
        expected = np.where((world[:, 0] > 0) & (world[:, 1] < 0), 3.0 * 0.8 / np.pi, 0.0)
        values, _ = shade(batch, fragments)
        clear = (np.abs(world[:, :2]) > 0.15).all(axis=1)
        np.testing.assert_allclose(values[clear], expected[clear], atol=2e-3)


def test_texels_of_no_triangle_stay_empty() -> None:
    """Blender 5.3 bakes them where a triangle touches them; they may belong to one that is baked apart."""
    for index in range(5):  # each fills half of a rectangle
        mesh_object("Half", SQUARE[:3], [(0, 1, 2)], diffuse(emission=1.0)).scale = (0.3 + 0.3 * index, 1.0, 1.0)
    _, atlas = baked(0.1)
    owners = np.concatenate([texel_owners(atlas.charts, page) for page in range(atlas.charts.page_count)])
    assert (owners < 0).any() and not atlas.texels[owners < 0].any()
    assert atlas.texels[owners >= 0].all()


def test_texels_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bake, "MAX_TEXELS", 300)
    square("Floor")
    sun(1.0)
    _, atlas = baked(0.01, 1)
    assert atlas.charts.texel_world > 0.01
    assert len(atlas.texels) <= 1024
    assert "texels" in atlas.warnings[0]
    with pytest.raises(SettingError, match="Samples per texel 0 is outside"):
        LightSettings(samples=0)


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


def test_scene_is_unchanged_at_every_step() -> None:
    before = user_scene()
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    assert_unchanged(before)
    reports = []
    for report in bake_luminance(bpy.context, source, 0.2, LightSettings(samples=2)):
        reports.append(report)
        assert_unchanged(before)
    assert reports[-1].fraction == 1.0
    assert_unchanged(before)


def test_scene_is_unchanged_after_cancel_and_error(monkeypatch: pytest.MonkeyPatch) -> None:
    before = user_scene()
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    steps = bake_luminance(bpy.context, source, 0.2, LightSettings(samples=2))
    while next(steps).label != "Baking light":
        pass
    steps.close()
    assert_unchanged(before)

    def fail(context: bpy.types.Context, target: BakeTarget) -> None:
        assert target.item.name in target.scene.objects
        raise RuntimeError("the device is gone")

    monkeypatch.setattr(baker, "bake_now", fail)
    with pytest.raises(RuntimeError, match="device"):
        drain(bake_luminance(bpy.context, source, 0.2, LightSettings(samples=2)))
    assert_unchanged(before)


def test_tiles_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    user_scene()
    baked_with = []
    for side in (4096, 8):
        monkeypatch.setattr(bake_scene, "tile_side", lambda side=side: side)
        source = read_scene(bpy.context.evaluated_depsgraph_get())
        baked_with.append(drain(bake_luminance(bpy.context, source, 0.1, LightSettings(samples=3))))
    assert baked_with[0].charts.page_side > 2 * 8
    np.testing.assert_array_equal(baked_with[0].texels, baked_with[1].texels)


@pytest.mark.parametrize("enabled", [False, True])
def test_gpus_bake_where_they_are_enabled(enabled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Device that Cycles is asked for; without a GPU it takes the processor all the same."""
    before = user_scene()
    devices = []
    run = baker.bake_now

    def look(context: bpy.types.Context, target: BakeTarget) -> None:
        devices.append(target.scene.cycles.device)
        run(context, target)

    monkeypatch.setattr(baker, "bake_now", look)
    monkeypatch.setattr(baker, "bakes_on_gpu", lambda context, device: enabled or gpu_is_enabled(context))
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    drain(bake_luminance(bpy.context, source, 0.5, LightSettings(samples=1)))
    assert set(devices) == {"GPU" if enabled or gpu_is_enabled(bpy.context) else "CPU"}
    assert_unchanged(before)


def test_edit_mode_stays() -> None:
    item = square("Floor", diffuse())
    sun(3.0)
    bpy.context.view_layer.objects.active = item
    bpy.ops.object.mode_set(mode="EDIT")
    values = shaded(*baked())
    assert item.mode == "EDIT"
    assert values["Floor"].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=1e-3)
    bpy.ops.object.mode_set(mode="OBJECT")


def test_a_failing_bake_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    item = square("Floor", diffuse())
    item.hide_render = True
    scene, layer = bpy.context.scene, bpy.context.view_layer
    with pytest.raises(SceneError, match="Cycles cannot bake"):
        baker.bake_now(bpy.context, BakeTarget(scene, layer, item, bpy.data.images.new("Any", 4, 4)))
