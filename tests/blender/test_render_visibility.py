# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxelize what Cycles renders, not what a viewport shows; the scene stays unchanged."""

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from patchnet.operators.cycles.camera_render import render_reference
from patchnet.operators.cycles.daylight import has_light
from patchnet.operators.pipeline.voxels_key import surface_key
from patchnet.operators.scene.cameras import choose_cameras, scene_cameras
from patchnet.operators.scene.images import ImageReader
from patchnet.operators.scene.materials import read_material
from patchnet.operators.scene.read import read_scene
from patchnet.operators.session import results
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.patchnet_addon.runtime.errors import EmptySelectionError
from patchnet.tests.blender.engine_scene import build_for_engine
from patchnet.tests.blender.job_scene import box, build
from patchnet.tests.blender.objects import collection_instance, geometry_nodes, group, moved_to
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import simple

BOUNDS = np.array([[-1.0, -1, -1], [1, 1, 1]])


@pytest.fixture(autouse=True)
def small(registered: None) -> bpy.types.Scene:
    """The small scene, open."""
    build()
    return bpy.context.scene


def read() -> dict[str, int]:
    """How often each object is placed in what is voxelized."""
    bpy.context.view_layer.update()
    before = scene_snapshot()
    parts = read_scene(bpy.context.evaluated_depsgraph_get()).parts
    assert_unchanged(before)
    found: dict[str, int] = {}
    for name in (name for part in parts for name in part.objects):
        found[name] = found.get(name, 0) + 1
    return found


def collection(name: str, *objects: bpy.types.Object) -> bpy.types.Collection:
    """A collection of its own with objects that are in no other."""
    return moved_to(bpy.data.collections.new(name), *objects)


def keyed(item: bpy.types.Object) -> None:
    item.hide_viewport = True
    item.keyframe_insert("hide_viewport", frame=1)


def driven(item: bpy.types.Object) -> None:
    item.driver_add("hide_viewport").driver.expression = "True"


def placed_by_nodes(item: bpy.types.Object, made: bpy.types.Collection) -> None:
    tree, _, out = geometry_nodes(bpy.data.objects["Lath 0"])
    info = tree.nodes.new("GeometryNodeCollectionInfo")
    info.inputs["Collection"].default_value = made
    tree.links.new(info.outputs[0], out)


def placed_by_particles(item: bpy.types.Object, made: bpy.types.Collection) -> None:
    slab = bpy.data.objects["Slab"]
    slab.modifiers.new("Stones", "PARTICLE_SYSTEM")
    settings = slab.particle_systems[0].settings
    settings.type, settings.count, settings.particle_size = "HAIR", 9, 1.0
    settings.render_type, settings.instance_collection = "COLLECTION", made


def of_layer() -> bpy.types.LayerCollection:
    return bpy.context.view_layer.layer_collection.children["Made"]


Act = Callable[[bpy.types.Object, bpy.types.Collection], object]
# How the collection of an object gets into the scene: linked into it, instanced, ...
PLACES: dict[str, Act] = {
    "linked": lambda item, made: bpy.context.scene.collection.children.link(made),
    "instanced": lambda item, made: collection_instance(made),
    "by geometry nodes": placed_by_nodes,
    "by particles": placed_by_particles,
}
HIDING: dict[str, tuple[str, Act]] = {
    "object": ("linked", lambda item, made: setattr(item, "hide_viewport", True)),
    "eye": ("linked", lambda item, made: item.hide_set(True)),
    "keyed": ("linked", lambda item, made: keyed(item)),
    "driven": ("linked", lambda item, made: driven(item)),
    "collection": ("linked", lambda item, made: setattr(made, "hide_viewport", True)),
    "eye of the collection": ("linked", lambda item, made: setattr(of_layer(), "hide_viewport", True)),
    "excluded": ("linked", lambda item, made: setattr(of_layer(), "exclude", True)),
    "renders": ("linked", lambda item, made: setattr(item, "hide_render", True)),
    "collection in renders": ("linked", lambda item, made: setattr(made, "hide_render", True)),
    "source": ("instanced", lambda item, made: setattr(item, "hide_viewport", True)),
    "source's collection": ("instanced", lambda item, made: setattr(made, "hide_viewport", True)),
    "source in renders": ("instanced", lambda item, made: setattr(item, "hide_render", True)),
    "instancer": ("instanced", lambda item, made: setattr(bpy.data.objects["Instance"], "hide_viewport", True)),
    "source of nodes": ("by geometry nodes", lambda item, made: setattr(item, "hide_viewport", True)),
    "object of nodes": (
        "by geometry nodes", lambda item, made: setattr(bpy.data.objects["Lath 0"], "hide_viewport", True)),
    "source of particles": ("by particles", lambda item, made: setattr(item, "hide_viewport", True)),
}  # fmt: skip
UNSEEN = {"excluded", "renders", "collection in renders", "source in renders"}


def place(item: bpy.types.Object, kind: str) -> None:
    """Put an object into the scene and hide it, as HIDING says."""
    where, hide = HIDING[kind]
    made = collection("Made", item)
    PLACES[where](item, made)
    bpy.context.view_layer.update()
    hide(item, made)
    bpy.context.view_layer.update()


@pytest.mark.parametrize("kind", HIDING)
def test_what_renders_show_is_voxelized_whatever_viewports_hide(small: bpy.types.Scene, kind: str) -> None:
    """As Cycles shows it: a bright box around all other objects."""
    bright = box("Bright", (-3, -3, -3), (3, 3, 3), 0.5)
    bright.material_slots[0].material = simple("Emission", Strength=99.0)
    place(bright, kind)
    found = read()
    (camera,) = choose_cameras(bpy.context.evaluated_depsgraph_get(), ("0 -9 0 > 0 0 0",), (8, 8), BOUNDS)
    seen = render_reference(bpy.context, camera, 1, 0).luminance.max() > 50.0
    assert ("Bright" in found) == seen == (kind not in UNSEEN)


@pytest.mark.parametrize(
    "kind", [kind for kind, (where, _) in HIDING.items() if kind not in UNSEEN and " " not in where]
)
def test_hidden_lamps_count_as_light(small: bpy.types.Scene, kind: str) -> None:
    """No daylight is added, and light is baked again after a change."""
    lamp = bpy.data.objects["Lamp"]
    place(lamp, kind)
    before = scene_snapshot()
    graph, settings = bpy.context.evaluated_depsgraph_get(), JobSettings.of()
    key = surface_key(graph, settings)
    assert has_light(graph)
    assert_unchanged(before)
    lamp.data.energy *= 2.0
    bpy.context.view_layer.update()
    assert surface_key(graph, settings) != key
    lamp.data.energy = 0.0
    bpy.context.view_layer.update()
    assert not has_light(graph)


def test_a_lamp_that_nothing_shows_is_no_light(small: bpy.types.Scene) -> None:
    place(bpy.data.objects["Lamp"], "collection in renders")
    bpy.data.collections["Made"].hide_viewport = True
    bpy.context.view_layer.update()
    assert not has_light(bpy.context.evaluated_depsgraph_get())


def test_values_without_a_keyframe_stay(small: bpy.types.Scene) -> None:
    """Muting a driver lets Blender evaluate all keyframes of its object."""
    slab = bpy.data.objects["Slab"]
    slab.keyframe_insert("location", frame=1)
    keyed(slab)
    slab.modifiers.new("Finer", "SUBSURF").driver_add("levels").driver.expression = "0"
    slab.location.x = 0.25
    assert "Slab" in read() and slab.location.x == 0.25


def test_a_mist_box_is_no_wall() -> None:
    material = bpy.data.objects["Slab"].material_slots[0].material
    tree = material.node_tree
    output = tree.nodes["Material Output"]
    tree.links.remove(output.inputs["Surface"].links[0])
    assert read_material(material, ImageReader())[0].alpha == 1.0, "with nothing at all it is black, as in Cycles"
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(volume.outputs[0], output.inputs["Volume"])
    assert read_material(material, ImageReader())[0].alpha == 0.0


def test_what_instances_leave_out(small: bpy.types.Scene) -> None:
    """Objects in them that no camera sees, that catch shadows, and collections that are disabled in renders."""
    seen, unseen, catcher, proxy = (box(name, (0, 0, 0), (1, 1, 1), 0.5) for name in ("Seen", "Un", "Catch", "Proxy"))
    unseen.visible_camera, catcher.is_shadow_catcher = False, True
    made = collection("Asset", seen, unseen, catcher)
    helpers = collection("Helpers", proxy)
    helpers.hide_render = True
    made.children.link(helpers)
    collection_instance(made)
    assert {"Seen", "Un", "Catch", "Proxy"} & read().keys() == {"Seen"}
    assert not helpers.hide_viewport
    helpers.hide_render = False
    assert "Proxy" in read()


@pytest.mark.parametrize("flag", ["holdout", "indirect_only"])
def test_one_collection_of_an_object_is_enough(small: bpy.types.Scene, flag: str) -> None:
    group("Held out").objects.link(bpy.data.objects["Slab"])
    assert "Slab" in read()
    setattr(bpy.context.view_layer.layer_collection.children["Held out"], flag, True)
    assert "Slab" not in read() and "Lath 0" in read()


def test_particles_of_a_render(small: bpy.types.Scene) -> None:
    """All of them and their children, however few of them the viewport shows."""
    stone, slab = box("Stone", (0, 0, 0), (0.1, 0.1, 0.1), 0.5), bpy.data.objects["Slab"]
    slab.modifiers.new("Stones", "PARTICLE_SYSTEM")
    settings = slab.particle_systems[0].settings
    settings.type, settings.count, settings.render_type, settings.instance_object = "HAIR", 40, "OBJECT", stone
    settings.display_percentage = 5
    assert read()["Stone"] == 41  # with the stone itself
    settings.child_type, settings.child_percent, settings.rendered_child_count = "SIMPLE", 1, 3
    assert read()["Stone"] == 121
    assert (settings.display_percentage, settings.child_percent) == (5, 1)


def test_geometry_nodes_that_ask_for_the_viewport_are_named() -> None:
    geometry_nodes(bpy.data.objects["Lath 0"], "Two Faces")[0].nodes.new("GeometryNodeIsViewport")
    bpy.context.view_layer.update()
    (warning,) = read_scene(bpy.context.evaluated_depsgraph_get()).warnings
    assert warning.startswith("Geometry nodes 'Two Faces' ask Is Viewport")


def test_what_is_not_as_cycles_shows_it_is_named(small: bpy.types.Scene) -> None:
    """Adaptive Subdivision, culling, and a view layer without Surfaces."""
    lath, cycles = bpy.data.objects["Lath 0"], small.cycles
    modifier = lath.modifiers.new("Finer", "SUBSURF")
    owner = modifier if hasattr(modifier, "use_adaptive_subdivision") else lath.cycles
    owner.use_adaptive_subdivision = small.render.use_simplify = True
    if owner is not modifier:
        cycles.feature_set = "EXPERIMENTAL"
    cycles.use_camera_cull = lath.cycles.use_camera_cull = lath.cycles.use_distance_cull = True
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    finer, culled = read_scene(graph).warnings
    assert finer.startswith("Adaptive Subdivision of 'Lath 0'") and culled.startswith("Voxels show 'Lath 0' everywhere")
    modifier.show_render = cycles.use_camera_cull = False
    assert read_scene(graph).warnings == []
    bpy.context.view_layer.use_solid = False
    with pytest.raises(EmptySelectionError, match="View layer 'ViewLayer' shows no Surfaces"):
        read_scene(graph)


def test_objects_of_a_background_scene_are_mentioned(small: bpy.types.Scene) -> None:
    """Its camera is looked through, if it is the active one."""
    small.background_set = other = bpy.data.scenes.new("Set")
    eye = bpy.data.objects["Eye"]
    small.collection.objects.unlink(eye)
    other.collection.objects.link(eye)
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    assert any("background scene 'Set'" in warning for warning in read_scene(graph).warnings)
    assert [camera.name for camera in choose_cameras(graph, (), (16, 16), BOUNDS)] == ["Eye"]


def test_what_cuts_holes_is_named(small: bpy.types.Scene) -> None:
    bpy.data.objects["Lath 1"].is_holdout = bpy.data.objects["Lath 3"].is_shadow_catcher = True
    group("Made", bpy.data.objects["Lath 2"])
    of_layer().holdout = True
    graph = bpy.context.evaluated_depsgraph_get()
    assert any("'Lath 1', 'Lath 2', 'Lath 3' have no voxels" in warning for warning in read_scene(graph).warnings)


def test_cameras_of_one_name(small: bpy.types.Scene, tmp_path: Path) -> None:
    """The active one is looked through by default, and each by a name of its own."""
    eye = bpy.data.objects["Eye"]
    made = collection("Rig", eye)
    path = tmp_path / "rig.blend"
    bpy.data.libraries.write(str(path), {made})
    build()
    scene = bpy.context.scene
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.collections = ["Rig"]
    scene.collection.children.link(wanted.collections[0])
    bpy.data.objects["Eye", None].matrix_world = Matrix.Translation((0, 0, 9))
    bpy.context.view_layer.update()
    assert list(scene_cameras(scene)) == ["Eye", "Eye [rig.blend]"]
    graph = bpy.context.evaluated_depsgraph_get()
    for names, height in (((), 9), (("Eye",), 9), (("Eye [rig.blend]",), 0.4)):
        (camera,) = choose_cameras(graph, names, (16, 16), BOUNDS)
        assert camera.position_world[2] == pytest.approx(height) and camera.name == (names or ("Eye",))[0]


def test_a_camera_with_a_comma_in_its_name() -> None:
    bpy.data.objects["Eye"].name = "Eye, left"
    graph = bpy.context.evaluated_depsgraph_get()
    assert [camera.name for camera in choose_cameras(graph, ("Eye", "left"), (16, 16), BOUNDS)] == ["Eye, left"]


def test_a_linked_scene_is_refused_with_a_sentence(small: bpy.types.Scene, tmp_path: Path) -> None:
    small.name = "Shot"
    path = tmp_path / "shot.blend"
    bpy.data.libraries.write(str(path), {small})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.scenes = ["Shot"]
    bpy.context.window.scene = wanted.scenes[0]
    with pytest.raises(RuntimeError, match=r"Scene 'Shot' is linked from .*shot\.blend.*open that file"):
        bpy.ops.patchnet.run_all(depth=4, max_samples=2, scope="VISIBLE")
    assert not any(item.name.startswith("PatchNet") for item in bpy.data.objects)


def test_each_view_layer_renders_its_own_objects(weights: Path, tmp_path: Path) -> None:
    """The voxels that are there stay those of the first one."""
    scene = build_for_engine(weights, tmp_path)
    group("Laths", *(item for item in scene.objects if item.name.startswith("Lath")))

    def depth(layer: str) -> np.ndarray:
        path = Path(scene.render.filepath).with_name(f"{layer}.exr")
        scene.render.filepath = str(path)
        assert bpy.ops.render.render(write_still=True) == {"FINISHED"}
        return read_exr(path)[f"{layer}.Depth.Z"]

    whole = depth("ViewLayer")
    voxels = results.voxels_of(scene)
    scene.view_layers.new("Slab").layer_collection.children["Laths"].exclude = True
    of_slab = depth("Slab")
    assert (of_slab > whole + 0.5).sum() > 20, "where a lath was, the slab is seen"
    np.testing.assert_array_equal(depth("ViewLayer"), whole)
    np.testing.assert_array_equal(depth("Slab"), of_slab)
    assert results.voxels_of(scene) is voxels
    with bpy.context.temp_override(view_layer=scene.view_layers["Slab"]):
        scene.view_layers["ViewLayer"].use = False
        np.testing.assert_array_equal(depth("Slab"), of_slab)
