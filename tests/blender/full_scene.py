# SPDX-License-Identifier: GPL-3.0-or-later
"""A file with everything that a job could change by accident, built from the small scene."""

from pathlib import Path

import bpy

from patchnet.tests.blender.job_scene import box, build
from patchnet.tests.blender.objects import group
from patchnet.tests.blender.shaders import read_by


def build_full(folder: Path, mode: str = "OBJECT") -> None:
    """Replace what is open; `folder` takes the file of a library. The slab is active, in `mode`."""
    _save_library(folder / "library.blend")
    build()
    scene = bpy.context.scene
    _link_library(folder / "library.blend")
    _settings(scene)
    _objects(scene)
    _images(folder)
    _animation()
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(bpy.data.objects["Lath 1"])
    other.render.engine = "CYCLES"
    _layers(scene)
    scene.frame_set(3)
    slab = bpy.data.objects["Slab"]
    bpy.context.view_layer.objects.active = slab
    # Blender remembers a tool for each mode that was ever entered, and nothing can make it forget one: whoever is in
    # a mode has been in object mode too.
    for visited in (mode, "OBJECT", mode):
        if slab.mode != visited:
            bpy.ops.object.mode_set(mode=visited)
    bpy.context.view_layer.update()


def _save_library(path: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    for index, name in enumerate(("Linked", "Overridden")):
        group(name, box(name, (0.2 * index, -0.2, -1.2), (0.2 * index + 0.1, -0.1, -1.1), 0.5))
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def _link_library(path: Path) -> None:
    names = ["Linked", "Overridden"]
    with bpy.data.libraries.load(str(path), link=True) as (_source, target):
        target.collections = names
    scene = bpy.context.scene
    scene.collection.children.link(bpy.data.collections["Linked"])
    linked = bpy.data.collections["Overridden"]
    scene.collection.children.link(linked)  # Blender 5.3 overrides nothing that is in no scene
    overridden = linked.override_hierarchy_create(scene, bpy.context.view_layer)
    scene.collection.children.unlink(linked)
    overridden.objects[0].location.x += 0.05


def _settings(scene: bpy.types.Scene) -> None:
    """Render and bake settings that nobody has by default."""
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.bake.margin, scene.render.bake.use_pass_direct = 5, False
    scene.render.bake.target, scene.render.bake.use_selected_to_active = "VERTEX_COLORS", True
    scene.cycles.bake_type = "AO"
    scene.cycles.samples, scene.cycles.tile_size, scene.cycles.use_auto_tile = 77, 512, False
    scene["of the user"] = {"a": 1, "b": [1.5, 2.5]}


def _objects(scene: bpy.types.Scene) -> None:
    """Hidden, locked and unselectable objects, UV maps, a driver, particles, custom properties."""
    item = bpy.data.objects
    item["Lath 1"].hide_set(True)
    item["Lath 2"].hide_render = True
    item["Lath 3"].hide_select = item["Lath 3"].lock_location[0] = True
    item["Lath 4"].hide_viewport = True
    slab = item["Slab"]
    slab["note"] = "mine"
    for name in ("First", "Second", "Third"):
        slab.data.uv_layers.new(name=name)
    slab.data.uv_layers["Second"].active = True
    slab.data.uv_layers["Third"].active_render = True
    for name in ("Other", "Active"):
        item["Lath 0"].data.uv_layers.new(name=name)
    item["Lath 0"].data.uv_layers["Active"].active = True
    slab.vertex_groups.new(name="Weights").add([0, 1], 0.5, "REPLACE")
    slab.modifiers.new("Bevel", "BEVEL").width = 0.01
    driver = slab.driver_add("location", 2).driver
    driver.expression = "0.01 * frame"
    item["Lath 0"].modifiers.new("Particles", "PARTICLE_SYSTEM")
    item["Lath 0"].particle_systems[0].settings.count = 5
    kept = bpy.data.materials.new("Kept")
    kept.use_fake_user = True
    item["Eye"].select_set(True)


def _images(folder: Path) -> None:
    """A painted image that is not saved, one that is packed, one in a file; the slab shows the last."""
    for name in ("Painted", "Packed", "Saved"):
        image = bpy.data.images.new(name, 4, 4)
        image.use_fake_user = True
        image.pixels[0] = 0.25
    bpy.data.images["Packed"].pack()
    saved = bpy.data.images["Saved"]
    saved.filepath_raw, saved.file_format = str(folder / "saved.png"), "PNG"
    saved.save()
    tree = bpy.data.materials["Slab"].node_tree
    tree.links.new(read_by("TexImage", image=saved)(tree), tree.nodes["Principled BSDF"].inputs["Base Color"])


def _animation() -> None:
    """A moving lamp, and a muted curve on its strength."""
    lamp = bpy.data.objects["Lamp"]
    for frame in (1, 10):
        lamp.location.x = frame
        lamp.keyframe_insert("location", frame=frame)
        lamp.data.energy = 3.0 + frame
        lamp.data.keyframe_insert("energy", frame=frame)
    action = lamp.data.animation_data.action
    action.layers[0].strips[0].channelbags[0].fcurves[0].mute = True
    lamp.data.animation_data.nla_tracks.new().mute = True
    lamp.data.energy = 3.0


def _layers(scene: bpy.types.Scene) -> None:
    """A second view layer that leaves a collection out and overrides materials."""
    layer = scene.view_layers.new("Second Layer")
    layer.layer_collection.children["Linked"].exclude = True
    layer.material_override = bpy.data.materials["Kept"]
    layer.use_pass_z = True
