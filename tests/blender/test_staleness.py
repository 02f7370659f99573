# SPDX-License-Identifier: GPL-3.0-or-later
"""Results become stale by what changed, not by what Blender reports."""

from collections.abc import Callable

import bpy
import pytest

from patchnet.operators.session import results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.operators.session.staleness import look_again
from patchnet.operators.state.scene_state import scene_state
from patchnet.tests.blender.job_scene import SMALL, box, principled

pytestmark = pytest.mark.usefixtures("scene")


def run(**values: object) -> None:
    assert bpy.ops.patchnet.run_all(**{"light": "two-lights", **SMALL, **values}) == {"FINISHED"}


def result() -> SceneResult:
    return results.voxels_of(bpy.context.scene)


def add_collection() -> None:
    bpy.context.scene.collection.children.link(bpy.data.collections.new("Empty"))


def report_everything() -> None:
    """Report as Blender does when a window closes: all data-blocks, none of them changed."""
    for kind in (bpy.data.objects, bpy.data.meshes, bpy.data.lights, bpy.data.materials, bpy.data.cameras):
        for block in kind:
            block.update_tag()


REPORTS: dict[str, Callable[[], object]] = {
    "a collection is added": add_collection,
    "an image is removed": lambda: bpy.data.images.remove(bpy.data.images.new("Gone", 4, 4)),
    "a scene is removed": lambda: bpy.data.scenes.remove(bpy.context.scene.copy()),
    "another object is added and removed": lambda: bpy.data.objects.remove(box("Gone", (0, 0, 0), (1, 1, 1), 0.5)),
    "everything is reported": report_everything,
    "another is selected": lambda: bpy.data.objects["Lath 1"].select_set(True),
    "the frame is set": lambda: bpy.context.scene.frame_set(7),
    "a camera turns": lambda: setattr(bpy.data.objects["Eye"], "rotation_euler", (1.2, 0.0, 0.1)),
    "another scene": lambda: bpy.data.scenes.new("Other"),
}


@pytest.mark.parametrize("name", REPORTS)
def test_reports_without_a_change_make_nothing_stale(name: str) -> None:
    run()
    REPORTS[name]()
    bpy.context.view_layer.update()
    assert result().stale == set(), result().reasons
    assert ("view" in result().reasons) == (name == "a camera turns")


def test_another_view_layer_is_shown() -> None:
    """One with the same objects fits; one without some does not, until the first is shown again."""
    run()
    scene, window = bpy.context.scene, bpy.context.window
    first, other = window.view_layer, scene.view_layers.new("Other")
    window.view_layer = other
    add_collection()
    bpy.context.view_layer.update()
    assert result().stale == set()
    window.view_layer = first
    laths = bpy.data.collections.new("Laths")
    scene.collection.children.link(laths)
    other.layer_collection.children["Laths"].exclude = True
    lath = bpy.data.objects["Lath 1"]
    laths.objects.link(lath)
    scene.collection.objects.unlink(lath)
    run()
    assert result().stale == set()
    for layer, stale in ((other, {"surface"}), (first, set())):
        window.view_layer = layer
        bpy.data.objects["Slab"].update_tag()
        bpy.context.view_layer.update()
        assert result().stale == stale, result().reasons
        assert "view layer 'Other' shows other objects" in result().why("surface") or not stale
    other.layer_collection.children["Laths"].exclude = False  # so that both show the same
    window.view_layer = other
    bpy.context.view_layer.update()
    assert result().stale == set()


CHANGES: dict[str, tuple[str, Callable[[], object], str]] = {
    "object deleted": ("surface", lambda: bpy.data.objects.remove(bpy.data.objects["Lath 1"]), "objects"),
    "object added": ("surface", lambda: box("New", (0, 0, 0), (1, 1, 1), 0.5), "objects"),
    "collection hidden": ("surface", lambda: hide_collection(), "objects"),
    "object hidden": ("surface", lambda: bpy.data.objects["Lath 1"].hide_set(True), "objects"),
    "object not rendered": ("surface", lambda: setattr(bpy.data.objects["Lath 1"], "hide_render", True), "'Lath 1'"),
    "lamp deleted": ("surface", lambda: bpy.data.objects.remove(bpy.data.objects["Lamp"]), "objects"),
    "lamp turned": ("light", lambda: setattr(bpy.data.objects["Lamp"], "rotation_euler", (0.1, 0, 0)), "lamp 'Lamp'"),
    "lamp brighter": ("light", lambda: setattr(bpy.data.lights["Lamp"], "energy", 9.0), "lamp 'Lamp'"),
    "world": ("light", lambda: setattr(bpy.data.worlds["Sky"], "color", (1, 0, 0)), "world 'Sky'"),
    "another world": ("light", lambda: setattr(bpy.context.scene, "world", bpy.data.worlds.new("New")), "world"),
    "material": ("light", lambda: setattr(principled("Slab").inputs["Roughness"], "default_value", 0.1), "material"),
    "vertex": ("surface", lambda: move_vertex("Slab"), "'Slab'"),
    "modifier": ("surface", lambda: bpy.data.objects["Slab"].modifiers.new("Shell", "SOLIDIFY"), "'Slab'"),
    "prototype of an instance": ("surface", lambda: move_vertex("Prototype"), "'Prototype'"),
    "keyed object at another frame": ("surface", lambda: key_and_go(), "'Lath 2'"),
}


def hide_collection() -> None:
    bpy.context.view_layer.layer_collection.children["Laths"].exclude = True


def move_vertex(name: str) -> None:
    bpy.data.meshes[name].vertices[0].co.x += 0.1
    bpy.data.meshes[name].update()


def key_and_go() -> None:
    item = bpy.data.objects["Lath 2"]
    for frame in (1, 9):
        item.location.z = frame
        item.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(5)


def richer() -> None:
    """The small scene with a world, a collection of its own, and an instance of what is only instanced."""
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("Sky")
    laths = bpy.data.collections.new("Laths")
    scene.collection.children.link(laths)
    lath = bpy.data.objects["Lath 4"]
    scene.collection.objects.unlink(lath)
    laths.objects.link(lath)
    prototype = box("Prototype", (0, 0, 0), (0.1, 0.1, 0.1), 0.5)
    scene.collection.objects.unlink(prototype)
    instanced = bpy.data.collections.new("Instanced")
    instanced.objects.link(prototype)
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", instanced
    scene.collection.objects.link(instance)
    bpy.context.view_layer.update()


@pytest.mark.parametrize("name", CHANGES)
def test_changes_are_noticed_and_named(name: str) -> None:
    richer()
    run()
    step, change, what = CHANGES[name]
    change()
    bpy.context.view_layer.update()
    assert step in result().stale
    assert what in result().why(step)


def test_a_change_that_is_taken_back_does_not_hold_up_a_render() -> None:
    """Marked by a change, and disproved by a comparison when a frame is rendered."""
    run()
    octree = result().octree
    slab = bpy.data.objects["Slab"]
    slab.location.x += 0.5
    bpy.context.view_layer.update()
    assert result().stale == {"surface"}
    slab.location.x -= 0.5
    bpy.context.view_layer.update()
    scene = bpy.context.scene
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PATCHNET", 8, 8
    bpy.ops.render.render()
    assert result().octree is octree and result().stale == set()


def test_settings_that_blender_does_not_report_are_seen_by_a_render() -> None:
    run()
    scene = bpy.context.scene
    scene.cycles.diffuse_bounces = 0
    bpy.context.view_layer.update()
    look_again(result(), scene)
    assert result().stale == {"light"} and result().why("light") == "world or render settings changed"
    scene.cycles.diffuse_bounces = 4
    look_again(result(), scene)
    assert result().stale == set()


def test_state_is_the_same_in_the_file_that_is_opened_again(tmp_path) -> None:
    richer()
    key_and_go()
    before = scene_state(bpy.context.scene)
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    after = scene_state(bpy.context.scene)
    assert before.differences(after) == {"surface": [], "light": []}
    assert before.identity() == after.identity() != before.identity("more")
    bpy.context.scene.frame_set(6)
    assert scene_state(bpy.context.scene).identity() != after.identity()
