# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair, points and emitters are voxelized and lit like in Cycles; objects without surface are named."""

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from patchnet.operators.scene import strands
from patchnet.operators.state.scene_state import SURFACE, scene_state
from patchnet.patchnet_addon.runtime.errors import EmptySelectionError
from patchnet.tests.blender.light_scene import assert_as_cycles, checked
from patchnet.tests.blender.objects import geometry_nodes, lamp, link, look_from, read, slab
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import grey, read_by, simple, world

pytestmark = pytest.mark.usefixtures("empty_scene")
LEAST_PSNR_DB, RATIO = 24.0, 0.06


def assert_like_cycles() -> str:
    """The octree over a floor, in the light of a sun and a grey sky, is what Cycles shows; its notes."""
    slab(low=(-1.5, -1.5), high=(1.5, 1.5))
    lamp("SUN", 3.0).rotation_euler = (0.7, 0.2, 0.5)
    world()
    look_from((1.6, -3.0, 2.6), (0, 0, 0.3))
    bpy.context.view_layer.update()
    before = scene_snapshot()
    check = checked(depth=8, size=(48, 48), max_samples=8, cameras=("Eye",))
    assert_unchanged(before)
    assert_as_cycles(check, LEAST_PSNR_DB, RATIO)
    return " ".join(check.report["warnings"])


def curves(count: int = 40, radius: float | None = 0.05, paint: bpy.types.Material | None = None) -> bpy.types.Object:
    """Hair curves of four points each, upright and slanted."""
    data, random = bpy.data.hair_curves.new("Fur"), np.random.default_rng(1)
    data.add_curves([4] * count)
    roots, ways = random.uniform(-0.9, 0.9, (count, 1, 3)), random.uniform(-0.3, 0.3, (count, 1, 3))
    roots[..., 2], ways[..., 2] = 0.0, 0.8
    points = roots + ways * np.linspace(0.0, 1.0, 4)[:, None]
    data.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    if radius is not None:
        values = data.attributes.new("radius", "FLOAT", "POINT").data
        values.foreach_set("value", np.full(4 * count, radius, np.float32))
    data.materials.append(paint or grey(0.7))
    return link(bpy.data.objects.new("Fur", data))


def node_points(radius: float = 0.1) -> bpy.types.Object:
    """A box whose geometry nodes make points of it."""
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.0, 0.0, 0.7))
    item = bpy.context.object
    item.name = "Cloud"
    tree, given, made = geometry_nodes(item)
    points, paint = tree.nodes.new("GeometryNodeDistributePointsOnFaces"), tree.nodes.new("GeometryNodeSetMaterial")
    size = tree.nodes.new("GeometryNodeSetPointRadius")
    points.inputs["Density"].default_value, size.inputs["Radius"].default_value = 20.0, radius
    paint.inputs["Material"].default_value = grey(0.7)
    for node in (points, size, paint):
        tree.links.new(given, node.inputs[0])
        given = node.outputs[0]
    tree.links.new(given, made)
    return item


def hair_ball(children: int = 0) -> bpy.types.Object:
    """A ball with particle hair, which a viewport does not show as renders do."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.4, location=(0.0, 0.0, 0.8))
    item = bpy.context.object
    item.name = "Ball"
    item.data.materials.append(grey(0.3))
    item.data.materials.append(grey(0.8))
    settings = item.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings
    settings.type, settings.count, settings.hair_length, settings.material = "HAIR", 60, 0.4, 2
    settings.root_radius, settings.tip_radius, settings.radius_scale = 2.0, 1.0, 0.05
    settings.display_method, settings.display_step, settings.display_percentage = "NONE", 1, 10
    if children:
        settings.child_type, settings.child_percent, settings.rendered_child_count = "SIMPLE", 1, children
        settings.child_radius = 0.3
    return item


def test_round_hair_curves() -> None:
    curves()
    bpy.context.scene.cycles_curves.shape = "THICK"
    assert_like_cycles()


@pytest.mark.parametrize(("kind", "component"), [("HairPrincipled", ""), ("Hair", "Reflection"), ("Toon", "GLOSSY")])
def test_shaders_that_are_gloss_alone(kind: str, component: str) -> None:
    """No part of their light is diffuse. The note says that theirs depends on the view."""
    paint = simple(f"Bsdf{kind}", "Shine", Color=(0.8, 0.7, 0.6, 1.0))
    if component:
        paint.node_tree.nodes[1].component = component
    curves(paint=paint)
    said = assert_like_cycles()
    assert "'Shine' is baked with reflections" in said and ("BSDF' of material 'Shine'" in said) == (kind != "Toon")


@pytest.mark.parametrize("kind", ["CATMULL_ROM", "POLY"])
def test_bent_hair_curves(kind: str) -> None:
    """Cycles draws curves through the points; of polylines straight lines since Blender 5.0."""
    item = curves()
    points = np.random.default_rng(3).uniform(-0.8, 0.8, (160, 3))
    points[:, 2] = (points[:, 2] + 0.8) * 0.6
    item.data.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    item.data.set_types(type=kind)
    assert_like_cycles()


def test_particle_hair_with_children() -> None:
    hair_ball(3)
    assert_like_cycles()


def test_points_of_geometry_nodes() -> None:
    node_points()
    assert_like_cycles()


def test_an_emitter_is_what_renders_show() -> None:
    ball = hair_ball()
    for shown in (True, False):
        ball.show_instancer_for_render, ball.show_instancer_for_viewport = shown, not shown
        assert len(read().parts) == 1 + shown
    assert_like_cycles()


@pytest.mark.parametrize("kind", ["VERTS", "NODES"])
@pytest.mark.parametrize("shown", [True, False])
def test_an_instancer_is_what_renders_show(kind: str, shown: bool) -> None:
    """One whose vertices have instances hides itself; geometry nodes replace it, and nothing else counts."""
    parent, child = slab("Parent"), slab("Child", low=(-0.1, -0.1), high=(0.1, 0.1))
    if kind == "VERTS":
        child.parent, parent.instance_type = parent, "VERTS"
    else:
        tree, given, made = geometry_nodes(parent)
        both, info = tree.nodes.new("GeometryNodeJoinGeometry"), tree.nodes.new("GeometryNodeObjectInfo")
        info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = child, True
        for socket in (given, info.outputs["Geometry"]):
            tree.links.new(socket, both.inputs[0])
        tree.links.new(both.outputs[0], made)
    parent.show_instancer_for_render, parent.show_instancer_for_viewport = shown, not shown
    names = [name for part in read().parts for name in part.objects]
    assert ("Parent" in names) == shown and names.count("Child") == (8 if kind == "VERTS" else 2)


def test_sizes_without_attributes() -> None:
    """Cycles takes 5 mm for hair and 10 mm for points."""
    strand = strands.read_strands(curves(radius=None), frozenset({"radius"}))
    assert (strand.radii == np.float32(0.005)).all()


def test_too_many_are_thinned_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    curves()
    whole = read()
    monkeypatch.setattr(strands, "FINE_TRIANGLES", 10)
    monkeypatch.setattr(strands, "MOST_TRIANGLES", 400)
    few = read()
    assert few.triangle_count <= 400 < whole.triangle_count
    strand = strands.read_strands(bpy.data.objects["Fur"], frozenset())
    assert len(strand.thinned(0.5).first) == 21 and strand.thinned(0.5).radii[0] == pytest.approx(0.1)
    (note,) = few.warnings
    assert note.startswith("Of the hair and points of 'Fur' 50% are voxelized")


def test_attributes_reach_the_corners() -> None:
    """Those of points and of strands, which materials name."""
    item = curves(2)
    item.data.attributes.new("Wet", "FLOAT", "CURVE").data.foreach_set("value", [0.25, 0.75])
    read_by("Attribute", attribute_name="Wet")(item.data.materials[0].node_tree)
    (part,) = read().parts
    wet = part.mesh.layers["Wet"]
    assert wet.shape == (len(part.mesh), 3, 1)
    assert set(np.unique(wet)) == {np.float32(0.25), np.float32(0.75)} and not np.ptp(wet, axis=1).any()


def test_an_attribute_with_the_name_of_another_one() -> None:
    """A colour where Blender 5.3 has types of strands; 4.5 makes no such attribute."""
    curves(2).data.attributes.new("curve_type", "FLOAT_COLOR", "POINT")
    (part,) = read().parts
    assert len(part.mesh)


def test_grease_pencil_and_volumes_are_named() -> None:
    bpy.ops.object.grease_pencil_add(type="MONKEY")
    bpy.context.object.name = "Sketch"
    link(bpy.data.objects.new("Smoke", bpy.data.volumes.new("Smoke")))
    with pytest.raises(EmptySelectionError, match=r"No visible object has a surface.*Grease pencil.*'Sketch'.*'Smoke'"):
        read()
    slab()
    warnings = read().warnings
    assert len(warnings) == 2 and all("left out, though renders show" in warning for warning in warnings)


def _grow(item: bpy.types.Object) -> None:
    item.particle_systems[0].settings.root_radius *= 2.0


def _move(item: bpy.types.Object) -> None:
    item.data.attributes["position"].data[0].vector.x += 0.1


def _divide(item: bpy.types.Object) -> None:
    """As many points of other strands."""
    old = item.data
    item.data = bpy.data.hair_curves.new("Other")
    item.data.add_curves([2, 6])
    points = np.empty(24, np.float32)
    old.attributes["position"].data.foreach_get("vector", points)
    item.data.attributes["position"].data.foreach_set("vector", points)
    bpy.data.hair_curves.remove(old)
    item.data.name = "Fur"


@pytest.mark.parametrize(("make", "change"), [(hair_ball, _grow), (curves, _move), (lambda: curves(2, None), _divide)])
def test_changes_of_hair_are_noticed(make: Callable, change: Callable) -> None:
    item = make()
    bpy.context.view_layer.update()
    before = scene_state(bpy.context.scene)
    assert before.differences(scene_state(bpy.context.scene), bpy.context.scene) == []
    change(item)
    found = before.differences(scene_state(bpy.context.scene), bpy.context.scene)
    assert any(SURFACE in each.steps for each in found)
