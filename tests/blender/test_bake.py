# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked light against light computed by hand; the scene stays unchanged."""

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
from patchnet.patchnet_addon.lightmap.chart_lookup import texel_owners, triangle_means
from patchnet.patchnet_addon.octree.voxelize import triangle_areas_and_normals
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender.light_scene import at_points
from patchnet.tests.blender.objects import CUBE_FACES, SQUARE, lamp, link, mesh
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import material, shader, shown, simple

pytestmark = pytest.mark.usefixtures("empty_scene")


def diffuse(color: tuple[float, float, float] = (0.5, 0.5, 0.5), emission: float = 0.0) -> bpy.types.Material:
    """Diffuse plus emission."""
    paint, tree = material("Diffuse")
    both = tree.nodes.new("ShaderNodeAddShader")
    for index, (kind, inputs) in enumerate(
        (("BsdfDiffuse", {"Color": (*color, 1.0)}), ("Emission", {"Strength": emission}))
    ):
        tree.links.new(shader(tree, kind, **inputs), both.inputs[index])
    shown(tree, both.outputs[0])
    return paint


def square(name: str, paint: bpy.types.Material | None = None, up: bool = True) -> bpy.types.Object:
    return link(mesh(name, SQUARE, [(0, 1, 2, 3) if up else (3, 2, 1, 0)], paint))


def cube(paint: bpy.types.Material | None = None, inside_out: bool = False) -> bpy.types.Object:
    vertices = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    return link(mesh("Cube", vertices, [face[::-1] if inside_out else face for face in CUBE_FACES], paint))


def sun(strength: float, rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    item = lamp("SUN", strength, angle=0.0)
    item.rotation_euler = rotation
    return item


def baked(texel_world: float = 0.25, samples: int = 16, sides: str = "six") -> tuple[SceneMesh, Atlas]:
    bpy.context.view_layer.update()
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    light = LightSettings(samples=samples, sides=sides, color=False)
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
            values, *_ = shade(batch, at_points(triangle, points))
            result.setdefault(names[batch.first_triangle + triangle], []).append(values)
    return {name: np.array(values) for name, values in result.items()}


def test_closed_box_under_the_sun_is_lambertian() -> None:
    cube(diffuse((0.5, 0.5, 0.5))).data.shade_flat()
    light = sun(3.0, (0.5, 0.3, 0.0))
    source, atlas = baked()
    towards = np.array(light.matrix_world.to_3x3() @ Vector((0, 0, 1)))
    (batch,) = source.batches()
    expected = np.maximum(triangle_areas_and_normals(batch.corners_world)[1] @ towards, 0.0) * 3.0 * 0.5 / np.pi
    values = shaded(source, atlas)["Cube"]
    np.testing.assert_allclose(values, np.broadcast_to(expected[:, None], values.shape), atol=1e-3)


# Sun from below, whether the material culls, sides of voxels, and light on front and back of sheets that face up and
# down, None where that is not baked; the luminance of both is the first that is there.
SHEETS = {
    "a dark side is not baked, even if it is the front": (0.0, False, "six", (3.0, None), (None, 3.0)),
    "both sides": (1.0, False, "six", (3.0, 1.0), (1.0, 3.0)),
    "shade is shade": (0.3, False, "six", (3.0, 0.3), (0.3, 3.0)),
    "next to no light is that of the inside of a building": (0.003, False, "six", (3.0, None), (None, 3.0)),
    "voxels without sides": (1.0, False, "one", (3.0, None), (1.0, None)),
    "Cycles culls nothing": (1.0, True, "six", (3.0, 1.0), (1.0, 3.0)),
    "a dark front of a material that culls": (0.0, True, "six", (3.0, None), (None, 3.0)),
}


@pytest.mark.parametrize("case", SHEETS)
def test_sides_of_sheets(case: str) -> None:
    below, culls, sides, up, down = SHEETS[case]
    paint = diffuse()
    paint.use_backface_culling = culls
    sun(3.0), sun(below, (np.pi, 0.0, 0.0))
    for index, name in enumerate(("Up", "Down")):
        square(name, paint, up=name == "Up").location = (10 * index, 0, 0)
    source, atlas = baked(sides=sides)
    values, names = shaded(source, atlas), [name for part in source.parts for name in part.objects for _ in (0, 1)]
    for name, wanted in (("Up", up), ("Down", down)):
        triangles = [index for index, owner in enumerate(names) if owner == name]
        for side, light in zip((atlas, atlas.back), wanted, strict=True):
            found = 0.0 if side is None else triangle_means(atlas.charts, side.texels, np.array(triangles))[:, 0].mean()
            assert found == pytest.approx((light or 0.0) * 0.5 / np.pi, rel=1e-3)
        assert values[name].mean() == pytest.approx((wanted[0] or wanted[1]) * 0.5 / np.pi, rel=1e-3)


def test_closed_boxes_that_are_lit_from_inside() -> None:
    """The inner side counts where nothing shines outside. A translucent sheet beside it has the mean of its
    sides."""
    cube(diffuse((0.5, 0.5, 0.5)))
    lamp("POINT", 40.0, (0.0, 0.0, 0.0), shadow_soft_size=0.01)
    cube(diffuse((0.5, 0.5, 0.5))).location.x = 20
    paint = diffuse((0.0, 0.0, 0.0))
    tree = paint.node_tree
    tree.nodes.new("ShaderNodeBsdfTranslucent")
    strength = tree.nodes.new("ShaderNodeMath")
    strength.operation = "MULTIPLY_ADD"
    strength.inputs[1].default_value, strength.inputs[2].default_value = 0.4, 0.4
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], strength.inputs[0])
    tree.links.new(strength.outputs[0], tree.nodes["Emission"].inputs["Strength"])
    sheet = square("Sheet", paint)
    sheet.location.x, sheet.scale = 20, (0.5, 0.5, 0.5)
    bpy.context.scene.cycles.diffuse_bounces = 0
    values = shaded(*baked(0.25, 64))
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


def test_emission_and_mixed_alpha() -> None:
    square("Lamp", diffuse((0.0, 0.0, 0.0), emission=2.5)).location = (50, 0, 0)
    half = {"Base_Color": (0.5, 0.5, 0.5, 1.0), "Specular_IOR_Level": 0.0, "Alpha": 0.75}
    square("Pane", simple("BsdfPrincipled", "Glassy", **half))
    sun(3.0)
    source, atlas = baked()
    values = shaded(source, atlas)
    assert values["Lamp"].mean() == pytest.approx(2.5, rel=1e-3)
    assert values["Pane"].mean() == pytest.approx(3.0 * 0.5 / np.pi, rel=5e-3), "opacity must be divided out"
    assert atlas.texels[:, 1].max() <= 1.0


def test_texels_of_no_triangle_stay_empty() -> None:
    """Blender 5.3 bakes them where a triangle touches them; they may belong to one that is baked apart."""
    for index in range(5):  # each fills half of a rectangle
        link(mesh("Half", SQUARE[:3], [(0, 1, 2)], diffuse(emission=1.0))).scale = (0.3 + 0.3 * index, 1.0, 1.0)
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


def test_a_failing_bake_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    item = square("Floor", diffuse())
    item.hide_render = True
    scene, layer = bpy.context.scene, bpy.context.view_layer
    with pytest.raises(SceneError, match="Cycles cannot bake"):
        baker.bake_now(bpy.context, BakeTarget(scene, layer, item, bpy.data.images.new("Any", 4, 4)))
