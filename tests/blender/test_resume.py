# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that is kept: a stopped bake resumes with the same bits, further cameras and samples add to it; its keys."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.computing.octrees import LitSurface
from patchnet.operators.cycles.bake import bake
from patchnet.operators.cycles.bake.bake import bake_key, bake_light
from patchnet.operators.state.scene_state import scene_state
from patchnet.patchnet_addon.light import surfel_cache
from patchnet.patchnet_addon.runtime.files import read_arrays
from patchnet.patchnet_addon.runtime.progress import Progress
from patchnet.tests.blender.job_scene import build, principled
from patchnet.tests.blender.light_scene import Baked, bake_job, on_bake
from patchnet.tests.blender.objects import geometry_nodes, look_from
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import read_by

LABEL, CALL_SURFELS = "Baking light", 500


@pytest.fixture(autouse=True)
def small_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bake, "_CALL_SURFELS", ((np.inf, CALL_SURFELS),))
    build()


@pytest.fixture
def surfels(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Number of surfels of each call while a test runs."""
    seen: list[int] = []
    on_bake(monkeypatch, lambda target: seen.append(len(target.item.data.polygons)))
    return seen


def bake_kept(
    stop_at: int | None = None, *, keeps: bool = True, cameras: Sequence[str] = (), **light: object
) -> tuple[LitSurface | None, np.ndarray, list[Progress]]:
    """Bake the open scene: light, its luminance of all fragments, reports.

    stop_at: closes the bake when so many surfels are finished.
    """
    state = scene_state(bpy.context.scene).identity() if keeps else ""
    job = bake_job(depth=6, cameras=cameras, state=state, **{"max_samples": 8, **light})
    steps, reports = bake_light(job), []
    try:
        while True:
            reports.append(next(steps))
            if stop_at is not None and reports[-1].label == LABEL and reports[-1].done >= stop_at:
                steps.close()
                return None, np.empty(0), reports
    except StopIteration as stop:
        return stop.value, Baked(job.source, job.clipped, stop.value).fragments.sides, reports


def files(root: Path) -> list[Path]:
    """Files of the only bake below a folder."""
    return sorted((root / "bakes").glob("*/*.safetensors"))


def test_resumed_bake_has_the_same_bits(light_of_its_own: Path, surfels: list[int]) -> None:
    before = scene_snapshot()
    whole, light, _ = bake_kept(keeps=False)
    assert whole is not None and files(light_of_its_own) == []
    all_calls = len(surfels)
    assert all_calls >= 8
    stopped, _, _ = bake_kept(stop_at=3 * CALL_SURFELS)
    assert stopped is None and len(files(light_of_its_own)) == 3
    assert_unchanged(before)
    surfels.clear()
    resumed, again, reports = bake_kept()
    assert resumed is not None
    np.testing.assert_array_equal(again, light)
    assert resumed.warnings == whole.warnings and resumed.notes == whole.notes
    assert len(surfels) == all_calls - 3 and len(files(light_of_its_own)) == all_calls
    assert any(report.label.startswith("Resuming: ") for report in reports)
    assert 0.0 < resumed.reused < 1.0
    surfels.clear()
    third, again, _ = bake_kept()
    assert third is not None and third.reused == 1.0 and not surfels, "finished light stays"
    np.testing.assert_array_equal(again, light)
    assert_unchanged(before)


def test_damaged_and_foreign_files_are_baked_again(light_of_its_own: Path, surfels: list[int]) -> None:
    _, light, _ = bake_kept()
    kept = files(light_of_its_own)
    count = sum(len(read_arrays(path, surfel_cache.KIND)[0]["ids"]) for path in kept[:2])
    content = bytearray(kept[0].read_bytes())
    content[-9] ^= 0xFF
    kept[0].write_bytes(content)
    kept[1].write_bytes(b"")
    (kept[0].parent / "notes.txt").write_text("no surfels")
    surfels.clear()
    _, again, _ = bake_kept()
    np.testing.assert_array_equal(again, light)
    assert sum(surfels) == count


def test_a_folder_that_cannot_be_written_costs_only_the_resuming(light_of_its_own: Path) -> None:
    occupied = light_of_its_own / "bakes"
    occupied.write_text("in the way")
    light, values, _ = bake_kept(max_samples=2)
    assert light is not None and values.any()
    assert occupied.read_text() == "in the way"


def test_a_full_disk_costs_only_the_resuming(light_of_its_own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(surfel_cache, "write_arrays", full)
    light, values, _ = bake_kept(max_samples=2)
    assert light is not None and values.any() and files(light_of_its_own) == []


def test_a_further_camera_bakes_only_what_it_newly_sees(light_of_its_own: Path, surfels: list[int]) -> None:
    look_from((3.0, -4.0, 0.4), (0.0, 0.0, 0.0), "Other")
    for name in ("Eye", "Other"):
        bpy.data.objects[name].data.lens = 30.0
    first, light, _ = bake_kept(cameras=("Eye",))
    alone = sum(surfels)
    surfels.clear()
    both, _, _ = bake_kept(cameras=("Eye", "Other"))
    newly = sum(surfels)
    shutil.rmtree(light_of_its_own / "bakes")
    surfels.clear()
    bake_kept(cameras=("Eye", "Other"))
    assert first is not None and both is not None
    assert 0 < newly < 0.7 * sum(surfels) and newly >= sum(surfels) - alone
    surfels.clear()
    _, again, _ = bake_kept(cameras=("Eye",))
    assert np.abs(again - light).mean() < 0.05 * light.mean(), "other paths of the same surfels"


def test_more_samples_add_to_what_is_there(surfels: list[int]) -> None:
    few, coarse, _ = bake_kept(max_samples=4)
    first = list(surfels)
    surfels.clear()
    more, fine, _ = bake_kept(max_samples=16)
    assert few is not None and more is not None
    assert sum(surfels) <= sum(first), "a further round, and not the first one again"
    assert more.reused == few.notes["light_paths"] / more.notes["light_paths"]
    assert more.notes["light_noise"] < few.notes["light_noise"]
    surfels.clear()
    _, again, _ = bake_kept(max_samples=4)
    assert not surfels
    np.testing.assert_array_equal(again, coarse)
    assert fine.any()


def key(scope: str = "VISIBLE", **light: object) -> str:
    return bake_key(bake_job(scope, depth=4, state=scene_state(bpy.context.scene).identity(), **light), "code")


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
    tree.links.new(read_by("Group", 0, node_tree=group)(tree), principled("Slab").inputs["Base Color"])
    for name in ("Painted", "Packed", "Picture"):
        picture = bpy.data.images.new(name, 4, 4, float_buffer=name == "Painted")
        read_by("TexImage", image=picture)(bpy.data.materials["Lath 3"].node_tree)
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
    assert key() == before == key(max_samples=5, noise_threshold=0.5, denoise=False)
    assert key(color=True) != before != key(daylight=True)
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
