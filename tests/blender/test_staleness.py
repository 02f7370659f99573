# SPDX-License-Identifier: GPL-3.0-or-later
"""Results are outdated by changes of the scene, not by Blender's reports."""

from collections.abc import Callable

import bmesh
import bpy
import pytest

from patchnet.operators.state.scene_state import scene_state
from patchnet.operators.state.watch import change_monitor, changes_meanwhile, read_state
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender.job_scene import box, principled, result, run_small
from patchnet.tests.blender.objects import collection_instance, group, link, moved_to, slid

pytestmark = pytest.mark.usefixtures("scene")


def add_collection() -> None:
    group("Empty")


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
    "another scene": lambda: bpy.data.scenes.new("Other"),
    "a camera turns": lambda: setattr(bpy.data.objects["Eye"], "rotation_euler", (1.2, 0.0, 0.1)),
}


def test_reports_without_a_change_make_nothing_stale() -> None:
    run_small()
    for name, report in REPORTS.items():
        report()
        bpy.context.view_layer.update()
        assert result().stale == set(), (name, result().reasons)


def test_another_view_layer_is_shown() -> None:
    """One with the same objects fits; one without some does not, until the first is shown again."""
    run_small()
    scene, window = bpy.context.scene, bpy.context.window
    first, other = window.view_layer, scene.view_layers.new("Other")
    window.view_layer = other
    add_collection()
    bpy.context.view_layer.update()
    assert result().stale == set()
    window.view_layer = first
    group("Laths", bpy.data.objects["Lath 1"])
    other.layer_collection.children["Laths"].exclude = True
    run_small()
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


SURFACE, LIGHT = "surface", "light"
Marks = dict[str, str]  # words for what does not fit, by step
Actions = tuple[Callable[[], object], Callable[[], object]]  # a change, and the way back by hand


def set_values(owner: Callable[[], object], name: str, new: object) -> Actions:
    """Set a property, and set it back by hand."""
    before: list[object] = []

    def change() -> None:
        value = getattr(owner(), name)
        before[:] = [tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value]
        setattr(owner(), name, new)

    return change, lambda: setattr(owner(), name, before[0])


def of(kind: str, name: str, key: str, value: object) -> Actions:
    return set_values(lambda: getattr(bpy.data, kind)[name], key, value)


def modifier(name: str, key: str, value: object) -> Actions:
    return set_values(lambda: bpy.data.objects[name].modifiers[0], key, value)


def added(make: Callable[[], bpy.types.Object]) -> Actions:
    """Add an object, and remove it."""
    names: list[str] = []

    def change() -> None:
        item = make()
        if item.name not in bpy.context.scene.collection.objects:
            bpy.context.scene.collection.objects.link(item)
        names[:] = [item.name]

    return change, lambda: bpy.data.objects.remove(bpy.data.objects[names[0]])


def unlinked(name: str) -> Actions:
    objects = bpy.data.objects
    return (
        lambda: bpy.context.scene.collection.objects.unlink(objects[name]),
        lambda: bpy.context.scene.collection.objects.link(objects[name]),
    )


def renamed() -> Actions:
    """Rename an object, its mesh, its material, its modifier and a lamp."""

    def rename(old: str, new: str) -> None:
        item = bpy.data.objects[old]
        item.name = item.data.name = item.material_slots[0].material.name = new
        item.select_set(new != "Ball")
        item.modifiers[0].name = new
        bpy.data.lights["Lamp" if new != "Ball" else "Light"].name = "Light" if new != "Ball" else "Lamp"

    return lambda: rename("Ball", "Sphere"), lambda: rename("Sphere", "Ball")


def edit_mode(change: bool) -> Actions:
    def edit(by: float) -> None:
        bpy.context.view_layer.objects.active = bpy.data.objects["Slab"]
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.context.view_layer.update()
        if change:
            mesh = bmesh.from_edit_mesh(bpy.data.meshes["Slab mesh"])
            mesh.verts.ensure_lookup_table()
            mesh.verts[0].co.x += by
            bmesh.update_edit_mesh(bpy.data.meshes["Slab mesh"])
        bpy.ops.object.mode_set(mode="OBJECT")

    return lambda: edit(0.25), lambda: edit(-0.25)


def empty() -> bpy.types.Object:
    return bpy.data.objects.new("Cross", None)


def color(value: float) -> Actions:
    return set_values(lambda: principled("Slab").inputs["Base Color"], "default_value", (value, 0.0, 0.0, 1.0))


def weight(name: str) -> Actions:
    group = bpy.data.objects[name].vertex_groups[0]
    return lambda: group.add([0], 1.0, "REPLACE"), lambda: group.add([0], 0.5, "REPLACE")


def excluded(name: str) -> Actions:
    layer = bpy.context.view_layer
    return set_values(lambda: layer.layer_collection.children[name], "exclude", True)


def hidden(name: str) -> Actions:
    return lambda: bpy.data.objects[name].hide_set(True), lambda: bpy.data.objects[name].hide_set(False)


def vertex(name: str) -> Actions:
    change, back = set_values(lambda: bpy.data.meshes[name].vertices[0], "co", (0.1, 0.2, 0.3))
    update = bpy.data.meshes[name].update_tag
    return lambda: (change(), update()), lambda: (back(), update())


MOVED = (0.0, 0.0, 0.3)
# By what the user does: how, and what is said then. Each is set back by hand, after which nothing is said.
TABLE: dict[str, tuple[Callable[[], Actions], Marks]] = {
    "nothing but a name": (renamed, {}),
    "an Empty is added": (lambda: added(empty), {}),
    "an Empty moves that nothing follows": (lambda: of("objects", "Nothing", "location", MOVED), {}),
    "an Empty moves that an object follows": (
        lambda: of("objects", "Handle", "location", MOVED),
        {SURFACE: "'Handle' changed"},
    ),
    "an Empty moves that a modifier looks at": (
        lambda: of("objects", "Center", "location", MOVED),
        {SURFACE: "'Center' changed"},
    ),
    "an Empty moves that a lamp follows": (
        lambda: of("objects", "Stand", "location", MOVED),
        {LIGHT: "'Stand' changed"},
    ),
    "Edit Mode without a change": (lambda: edit_mode(False), {}),
    "Edit Mode with a change": (lambda: edit_mode(True), {SURFACE: "'Slab' changed"}),
    "an object that does not render moves": (lambda: of("objects", "Unrendered", "location", MOVED), {}),
    "an object that shades moves": (lambda: of("objects", "Shade", "location", MOVED), {LIGHT: "'Shade' changed"}),
    "a vertex moves": (lambda: vertex("Prototype"), {SURFACE: "'Prototype' changed"}),
    "an object is hidden in viewports": (lambda: hidden("Lath 1"), {}),
    "an object is disabled in viewports": (lambda: of("objects", "Lath 1", "hide_viewport", True), {}),
    "a collection is disabled in viewports": (lambda: of("collections", "Laths", "hide_viewport", True), {}),
    "an object moves that renders alone show": (
        lambda: of("objects", "Lath 2", "location", MOVED),
        {SURFACE: "'Lath 2' changed"},
    ),
    "an object is not rendered": (lambda: of("objects", "Lath 1", "hide_render", True), {SURFACE: "'Lath 1'"}),
    "an object is taken out": (lambda: unlinked("Lath 1"), {SURFACE: "'Lath 1' was removed"}),
    "an object is added": (lambda: added(lambda: box("New", (0, 0, 0), (1, 1, 1), 0.5)), {SURFACE: "'New' was added"}),
    "a prototype moves": (lambda: of("objects", "Prototype", "location", MOVED), {SURFACE: "'Prototype' changed"}),
    "a collection is excluded": (lambda: excluded("Laths"), {SURFACE: "'Lath 4' was hidden"}),
    "a lamp is taken out": (lambda: unlinked("Lamp"), {LIGHT: "lamp 'Lamp' was removed"}),
    "a lamp turns": (lambda: of("objects", "Lamp", "rotation_euler", (0.1, 0, 0)), {LIGHT: "lamp 'Lamp' changed"}),
    "a lamp is brighter": (lambda: of("lights", "Lamp", "energy", 9.0), {LIGHT: "lamp 'Lamp' changed"}),
    "the world": (lambda: of("worlds", "Sky", "color", (1, 0, 0)), {LIGHT: "world 'Sky' changed"}),
    "a color": (lambda: color(0.7), {LIGHT: "material 'Slab' changed"}),
    "the layer's material": (
        lambda: of("materials", "Clay", "diffuse_color", (1, 0, 0, 1)),
        {LIGHT: "material 'Clay' changed"},
    ),
    "a weight": (lambda: weight("Ball"), {SURFACE: "'Ball' changed"}),
    "levels of a render": (lambda: modifier("Ball", "render_levels", 3), {SURFACE: "'Ball' changed"}),
    "a modifier that does not render": (lambda: modifier("Ball", "show_render", False), {SURFACE: "'Ball' changed"}),
    "resolution of a rendered curve": (
        lambda: of("curves", "Wire", "render_resolution_u", 3),
        {SURFACE: "'Wire' changed"},
    ),
    "children of rendered hair": (
        lambda: of("particles", "Fur", "rendered_child_count", 3),
        {SURFACE: "'Slab' changed"},
    ),
    "bounces of light": (
        lambda: set_values(lambda: bpy.context.scene.cycles, "diffuse_bounces", 0),
        {LIGHT: "world or render settings changed"},
    ),
}


def full() -> None:
    """The richer scene with an object of each kind that the table speaks of; meshes have names of their own."""
    richer()
    data = bpy.data
    data.meshes["Slab"].name = "Slab mesh"
    for name in ("Nothing", "Handle", "Center", "Stand"):
        link(data.objects.new(name, None))
    for child, parent in (("Lath 3", "Handle"), ("Lamp", "Stand")):
        data.objects[child].parent = data.objects[parent]
    for name in ("Shade", "Unrendered", "Ball"):
        box(name, (1.5, 0, 0), (1.7, 0.2, 0.2), 0.5)
    data.objects["Shade"].visible_camera = False
    data.objects["Unrendered"].hide_render = data.objects["Lath 2"].hide_viewport = True
    data.objects["Ball"].modifiers.new("Smooth", "SUBSURF")
    data.objects["Ball"].vertex_groups.new(name="Soft").add([0], 0.5, "REPLACE")
    bpy.context.view_layer.material_override = data.materials.new("Clay")
    data.objects["Lath 0"].modifiers.new("Push", "CAST").object = data.objects["Center"]
    data.objects["Slab"].modifiers.new("Hair", "PARTICLE_SYSTEM")
    fur = data.particles[0]
    fur.name, fur.type, fur.child_type, fur.count = "Fur", "HAIR", "INTERPOLATED", 2
    wire = data.curves.new("Wire", "CURVE")
    wire.splines.new("BEZIER").bezier_points.add(1)
    wire.bevel_depth = 0.1
    link(data.objects.new("Wire", wire))
    bpy.context.view_layer.update()


def test_table_of_what_is_said_and_taken_back() -> None:
    """One result goes through all: after each change that is set back by hand nothing is marked."""
    full()
    run_small(depth=5)
    wrong = []
    for name, (actions, expected) in TABLE.items():
        change, back = actions()
        change()
        bpy.context.view_layer.update()
        found = {step: result().why(step) for step in sorted(result().stale)}
        if found.keys() != expected.keys() or any(expected[step] not in found[step] for step in expected):
            wrong.append((name, "said", found, "for", expected))
        back()
        bpy.context.view_layer.update()
        if result().stale:
            wrong.append((name, "kept", str(result().reasons)))
    assert not wrong, "\n".join(map(str, wrong))


def key_and_go() -> None:
    slid(bpy.data.objects["Lath 2"], {1: 1.0, 9: 9.0}, axis=2)
    bpy.context.scene.frame_set(5)


def richer() -> None:
    """The small scene with a world, a collection of its own, and an instance of what is only instanced."""
    bpy.context.scene.world = bpy.data.worlds.new("Sky")
    group("Laths", bpy.data.objects["Lath 4"])
    prototype = box("Prototype", (0, 0, 0), (0.1, 0.1, 0.1), 0.5)
    collection_instance(moved_to(bpy.data.collections.new("Instanced"), prototype))
    bpy.context.view_layer.update()


def test_keys_make_an_object_stale_at_another_frame() -> None:
    run_small()
    key_and_go()
    bpy.context.view_layer.update()
    assert "'Lath 2'" in result().why("surface")


def test_state_is_the_same_in_the_file_that_is_opened_again(tmp_path) -> None:
    richer()
    key_and_go()
    before = scene_state(bpy.context.scene)
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    after = scene_state(bpy.context.scene)
    assert before.differences(after, bpy.context.scene) == []
    assert before.identity() == after.identity() != before.identity("more")
    bpy.context.scene.frame_set(6)
    assert scene_state(bpy.context.scene).identity() != after.identity()


def test_a_job_sees_edits_from_its_reading_on() -> None:
    """Also of what is read already; reports without a change are compared once."""
    scene, monitor = bpy.context.scene, change_monitor()
    many = [box(f"Box {number}", (0, 0, 0), (1, 1, 1), 0.5) for number in range(300)]
    monitor.begin(scene)
    try:
        reading = read_state(scene)
        next(reading)
        bpy.data.objects.remove(many[0])
        with pytest.raises(SceneError, match="deleted while the scene was read: start again"):
            drain(reading)
        reading = read_state(scene)
        next(reading)
        for item in many[1:]:
            item.location.z = 1.0
        monitor.note_update(scene)
        drain(reading)
        assert "'Box 299' changed" in [change.text for change in changes_meanwhile()]
        drain(read_state(scene))
        monitor.note_update(scene)
        assert changes_meanwhile() == [] and not monitor.edited
    finally:
        monitor.end()
