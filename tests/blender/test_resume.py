# SPDX-License-Identifier: GPL-3.0-or-later
"""A stopped or killed bake resumes and ends with the same bits; keys of its pages."""

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles.bake import KeptPages, bake_luminance
from patchnet.operators.cycles.bake.bake import bake_key
from patchnet.operators.scene.read import read_scene
from patchnet.operators.settings.groups import LightSettings
from patchnet.operators.state.scene_state import scene_state
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.charts import layout_charts
from patchnet.patchnet_addon.lightmap.page_cache import BakePageCache
from patchnet.patchnet_addon.runtime.progress import Progress, drain
from patchnet.tests.blender.job_scene import build, principled
from patchnet.tests.blender.objects import geometry_nodes
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

LABEL = "Baking light"


@pytest.fixture(autouse=True)
def small_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATCHNET_PAGE_SIDE", "16")
    build()


def bake(kept: BakePageCache | None, stop_at: int | None = None) -> tuple[Atlas | None, list[Progress]]:
    """Bake the open scene; `stop_at` closes the bake when so many pages are finished."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    pages = None if kept is None else KeptPages(kept, scene_state(bpy.context.scene).identity())
    steps = bake_luminance(bpy.context, read_scene(depsgraph), 0.1, LightSettings(samples=4), kept=pages)
    reports: list[Progress] = []
    try:
        while True:
            reports.append(next(steps))
            if stop_at is not None and reports[-1].label == LABEL and reports[-1].done >= stop_at:
                steps.close()
                return None, reports
    except StopIteration as stop:
        return stop.value, reports


def folders(root: Path) -> list[Path]:
    return sorted(root.iterdir()) if root.exists() else []


def test_resumed_bake_has_the_same_bits(tmp_path: Path, bakes: list[str]) -> None:
    slab = bpy.data.objects["Slab"].copy()  # one more, for more pages
    slab.location.x += 5.0
    bpy.context.scene.collection.objects.link(slab)
    bpy.context.view_layer.update()
    before = scene_snapshot()
    whole, _ = bake(None)
    assert whole is not None
    count, all_calls = whole.charts.page_count, len(bakes)
    assert count >= 5
    with pytest.raises(KeyboardInterrupt), BakePageCache(tmp_path) as kept:
        bake(kept, stop_at=3)
        raise KeyboardInterrupt
    assert_unchanged(before)
    (folder,) = folders(tmp_path)
    assert len(list(folder.iterdir())) == 3
    bakes.clear()
    with BakePageCache(tmp_path) as kept:
        resumed, reports = bake(kept)
        assert len(list(folder.iterdir())) == count
    assert resumed is not None
    np.testing.assert_array_equal(resumed.texels, whole.texels)
    assert resumed.warnings == whole.warnings
    assert 0 < len(bakes) < all_calls
    assert f"Resuming: 3 of {count} pages are there" in [report.label for report in reports]
    assert min(report.done for report in reports if report.label == LABEL) == 3
    assert folders(tmp_path) == [], "nobody needs them any more"
    assert_unchanged(before)


def test_damaged_and_foreign_pages_are_baked_again(tmp_path: Path) -> None:
    whole, _ = bake(None)
    assert whole is not None
    with pytest.raises(KeyboardInterrupt), BakePageCache(tmp_path) as kept:
        bake(kept, stop_at=3)
        raise KeyboardInterrupt
    (folder,) = folders(tmp_path)
    pages = sorted(folder.iterdir())
    content = bytearray(pages[0].read_bytes())
    content[-9] ^= 0xFF
    pages[0].write_bytes(content)
    pages[1].write_bytes(b"")
    (folder / "notes.txt").write_text("not a page")
    with BakePageCache(tmp_path) as kept:
        resumed, _ = bake(kept)
    assert resumed is not None
    np.testing.assert_array_equal(resumed.texels, whole.texels)


def test_a_folder_that_cannot_be_written_costs_only_the_resuming(tmp_path: Path) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("in the way")
    with BakePageCache(occupied) as kept:
        atlas, _ = bake(kept)
    assert atlas is not None and atlas.texels.any()
    assert occupied.read_text() == "in the way"


def key(scope: str = "VISIBLE", samples: int = 4) -> str:
    bpy.context.view_layer.update()
    source = read_scene(bpy.context.evaluated_depsgraph_get(), scope)
    charts = drain(layout_charts(source, 0.1))
    return bake_key(scene_state(bpy.context.scene).identity(), source, charts, samples, 0)


def group_node(name: str) -> bpy.types.Node:
    return bpy.data.node_groups["Group"].nodes[name]


def move_vertex(name: str) -> None:
    bpy.data.objects[name].data.vertices[0].co.x += 1e-5
    bpy.data.objects[name].data.update()


def paint() -> None:
    bpy.data.images["Painted"].pixels[0] = 0.123
    bpy.data.images["Painted"].update()


def pack(value: float) -> None:
    image = bpy.data.images["Packed"]
    image.pixels.foreach_set([value] * 64)
    image.pack()


def save_picture(value: float) -> None:
    image = bpy.data.images["Picture"]
    image.pixels.foreach_set([value] * 64)
    image.save()


CHANGES: dict[str, Callable[[], object]] = {
    "colour": lambda: setattr(principled("Slab").inputs["Roughness"], "default_value", 0.123),
    "colour in a group": lambda: setattr(group_node("RGB").outputs[0], "default_value", [0.1] * 4),
    "ramp": lambda: setattr(group_node("Ramp").color_ramp.elements[1], "position", 0.7),
    "link": lambda: bpy.data.materials["Slab"].node_tree.links.remove(bpy.data.materials["Slab"].node_tree.links[0]),
    "pixels": paint,
    "packed pixels": lambda: pack(0.7),
    "picture file": lambda: save_picture(0.7),
    "lamp": lambda: setattr(bpy.data.lights["Lamp"], "energy", 3.001),
    "world": lambda: setattr(bpy.context.scene, "world", bpy.data.worlds.new("New")),
    "vertex of what is baked": lambda: move_vertex("Slab"),
    "vertex of another object": lambda: move_vertex("Lath 1"),
    "vertex of an object that viewports do not show": lambda: move_vertex("Lath 4"),
    "object moved": lambda: setattr(bpy.data.objects["Lath 2"], "location", (0.0, 0.0, 1e-4)),
    "object hidden": lambda: setattr(bpy.data.objects["Lath 2"], "hide_render", True),
    "bounces": lambda: setattr(bpy.context.scene.cycles, "diffuse_bounces", 2),
    "guided paths": lambda: setattr(bpy.context.scene.cycles, "use_guiding", True),
}  # fmt: skip


def richer_scene(folder: Path) -> None:
    """The small scene with a node group, painted, packed and saved images, and an object that only renders show."""
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    rgb, ramp = group.nodes.new("ShaderNodeRGB"), group.nodes.new("ShaderNodeValToRGB")
    rgb.name, ramp.name = "RGB", "Ramp"
    group.links.new(rgb.outputs[0], ramp.inputs[0])
    group.links.new(ramp.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    tree = bpy.data.materials["Slab"].node_tree
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], principled("Slab").inputs["Base Color"])
    texture = bpy.data.materials["Lath 3"].node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("Painted", 4, 4, float_buffer=True)
    for name in ("Packed", "Picture"):
        texture = bpy.data.materials["Lath 3"].node_tree.nodes.new("ShaderNodeTexImage")
        texture.image = bpy.data.images.new(name, 4, 4)
    pack(0.5)
    bpy.data.images["Picture"].filepath_raw = str(folder / "picture.png")
    bpy.data.images["Picture"].file_format = "PNG"
    save_picture(0.5)
    bpy.data.objects["Lath 4"].hide_viewport = True
    bpy.data.objects["Slab"].select_set(True)


@pytest.mark.parametrize("name", CHANGES)
def test_key_changes_with_what_is_seen(name: str, tmp_path: Path) -> None:
    """Also where it is none of the objects that are baked."""
    richer_scene(tmp_path)
    before = key("SELECTED")
    CHANGES[name]()
    assert key("SELECTED") != before


def test_key_stays_with_what_is_not_seen(tmp_path: Path) -> None:
    richer_scene(tmp_path)
    before = key()
    assert key() == before and key(samples=5) != before
    principled("Slab").location = (5.0, 5.0)
    principled("Slab").select = True
    bpy.context.scene.render.filepath = "//elsewhere"
    bpy.context.view_layer.objects.active = bpy.data.objects["Lath 1"]
    bpy.data.objects["Lath 1"].select_set(True)
    assert key() == before
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert key() == before


def give_number(item: bpy.types.Object, value: float) -> None:
    """Set the number that the nodes of `bevelled` are given."""
    modifier = item.modifiers["Nodes"]
    name = modifier.node_group.interface.items_tree["Number"].identifier
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, name).value = value
    else:
        modifier[name] = value


def bevelled(count: int = 1) -> list[bpy.types.Object]:
    """Cuboids with a bevel: Blender takes the means of their UVs in the order of addresses."""
    first = bpy.data.objects["Lath 1"]
    uvs = first.data.uv_layers.new(name="UVMap").uv
    for corner, loop in enumerate(first.data.loops):
        x, y, z = first.data.vertices[loop.vertex_index].co
        uvs[corner].vector = 1.3 * x + 0.7 * z, 0.9 * y + 0.3 * z
    first.modifiers.new("Bevel", "BEVEL").width = 0.02
    first.modifiers["Bevel"].segments = 3
    first.modifiers.new("Array", "ARRAY").count = 3
    tree, given, made = geometry_nodes(first)
    tree.interface.new_socket("Number", in_out="INPUT", socket_type="NodeSocketFloat")
    tree.links.new(given, made)
    copies = [first.copy() for _ in range(count - 1)]
    for item in copies:
        bpy.context.scene.collection.objects.link(item)
    return [first, *copies]


def evaluated_uvs(item: bpy.types.Object) -> bytes:
    data = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    values = np.empty((len(data.loops), 2), np.float32)
    data.uv_layers[0].uv.foreach_get("vector", values.ravel())
    return values.tobytes()


def test_bevels_have_one_key() -> None:
    """Objects are evaluated side by side, so that addresses follow no order."""
    items = bevelled(40)
    uvs, keys = set(), set()
    for _ in range(5):
        for item in items:
            item.update_tag()
        keys.add(key())
        uvs.update(map(evaluated_uvs, items))
    assert len(keys) == 1
    if len(uvs) == 1:  # most often in Blender 5.2, where they differ in larger scenes
        pytest.skip("the bevel evaluated to the same bits each time")


@pytest.mark.parametrize("change", ["UV", "bevel", "nodes"])
def test_a_change_of_what_is_bevelled_changes_the_key(change: str) -> None:
    (item,) = bevelled()
    before = key()
    if change == "UV":
        item.data.uv_layers[0].uv[3].vector.x += 1e-5
    elif change == "bevel":
        item.modifiers["Bevel"].loop_slide = False
    else:
        give_number(item, 0.5)
    item.data.update()
    item.update_tag()
    assert key() != before
