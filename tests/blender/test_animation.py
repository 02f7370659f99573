# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake animations: the scene at each frame, finished frames are skipped, the file stays unchanged."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Vector

from patchnet.operators.animation.animation import AnimationResult, FramePlan, bake_frames
from patchnet.operators.animation.frame_maker import JobMaker
from patchnet.operators.pipeline import run
from patchnet.operators.session import results
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.errors import PatchNetError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.blender.job_scene import drop_result_images, frames_of_calls, random_weights
from patchnet.tests.blender.objects import geometry_nodes
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

QUICK = {"light": "two-lights", "size": (16, 16), "depth": 5}
LIT = {"light": "cycles", "max_samples": 2, "size": (16, 16), "depth": 5}


@pytest.fixture(autouse=True)
def scene(scene: bpy.types.Scene) -> bpy.types.Scene:
    """The small scene, with a slab that moves within frames 1 to 3 and stays within the bounds of frame 1."""
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 3, 1
    keyed(bpy.data.objects["Slab"], "location", {1: (0, 0, 0), 3: (0, -0.8, 0)})
    return scene


def keyed(owner: bpy.types.bpy_struct, path: str, values: dict[int, object]) -> None:
    """Key values of a property at frames; the scene is at frame 2 afterwards."""
    for frame, value in values.items():
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=frame)
    bpy.context.scene.frame_set(2)


def bake(out: Path, weights: Path, frames: Sequence[int] = (1, 2, 3), **values: object) -> AnimationResult:
    plan = {name: values.pop(name) for name in ("overwrite", "one_grid") if name in values}
    settings = JobSettings.of(weights=weights, **{**QUICK, **values})
    return drain(bake_frames(bpy.context, JobMaker(settings), FramePlan(tuple(frames), out, **plan)))


def octree(out: Path, frame: int) -> Octree:
    return load_octree(out / f"frame-{frame:04d}" / "octree.safetensors")


def report(out: Path, frame: int) -> dict[str, object]:
    return json.loads((out / f"frame-{frame:04d}" / "report.json").read_text())


def leaves_world(tree: Octree) -> np.ndarray:
    """Luminance-free picture of an octree: its leaves' centres, sorted."""
    return np.sort(tree.keys(tree.depth))


def test_each_frame_is_the_scene_at_that_frame(tmp_path: Path, weights: Path, scene: bpy.types.Scene) -> None:
    before = scene_snapshot()
    result = bake(tmp_path / "out", weights)
    assert_unchanged(before)
    assert scene.frame_current == 2
    assert result.made == [1, 2, 3] and result.skipped == []
    assert not np.array_equal(leaves_world(octree(tmp_path / "out", 1)), leaves_world(octree(tmp_path / "out", 3)))
    for frame in (1, 3):
        scene.frame_set(frame)
        alone = tmp_path / f"alone-{frame}"
        given = {"frame_start": frame, "frame_end": frame, "out": str(alone), "scope": "VISIBLE"}
        exposure = octree(tmp_path / "out", 1).exposure
        quick = {**QUICK, "exposure": exposure} if frame > 1 else QUICK
        assert bpy.ops.patchnet.bake_animation(**given, **quick) == {"FINISHED"}
        np.testing.assert_array_equal(octree(alone, frame).child_mask, octree(tmp_path / "out", frame).child_mask)
        np.testing.assert_array_equal(octree(alone, frame).luminance, octree(tmp_path / "out", frame).luminance)
        assert octree(alone, frame).provenance["frame"] == frame
    whole = json.loads((tmp_path / "out" / "report.json").read_text())
    assert whole["complete"] and [entry["frame"] for entry in whole["frames"]] == [1, 2, 3]
    assert whole == json.loads(json.dumps(result.report))


def test_a_moving_lamp_gives_other_light(tmp_path: Path, weights: Path, scene: bpy.types.Scene) -> None:
    bpy.data.objects["Slab"].animation_data_clear()
    keyed(bpy.data.objects["Lamp"], "rotation_euler", {1: (0.9, 0.2, 0.1), 2: (-0.9, 0.2, 3.1)})
    keyed(bpy.data.lights["Lamp"], "energy", {1: 3.0, 2: 3.0, 3: 0.0})
    before = scene_snapshot()
    bake(tmp_path, weights, **LIT)
    assert_unchanged(before)
    trees = [octree(tmp_path, frame) for frame in (1, 2, 3)]
    np.testing.assert_array_equal(trees[0].child_mask, trees[1].child_mask)
    first, second, dark = (tree.luminance for tree in trees)
    assert np.abs(first - second).max() > 0.3
    assert first.max() > 0.5 and dark.max() == 0.0, "a lamp that is off gets no sun instead, and no other exposure"
    assert {tree.exposure for tree in trees} == {trees[0].exposure}


def test_deformation_instances_and_visibility(tmp_path: Path, weights: Path, scene: bpy.types.Scene) -> None:
    bpy.data.objects["Slab"].animation_data_clear()
    keyed(bpy.data.objects["Lath 0"], "hide_render", {1: False, 2: True})
    lath = bpy.data.objects["Lath 1"]
    lath.shape_key_add(name="Basis")
    shape = lath.shape_key_add(name="Wide")
    for point in shape.data:
        point.co.x += 0.25
    keyed(shape, "value", {1: 0.0, 2: 0.0, 3: 1.0})
    scattered(bpy.data.objects["Lath 2"])
    scene.frame_set(2)
    before = scene_snapshot()
    bake(tmp_path, weights, (1, 2, 3, 4), one_grid=True)
    assert_unchanged(before)
    leaves = [leaves_world(octree(tmp_path, frame)) for frame in (1, 2, 3, 4)]
    assert len(np.setdiff1d(leaves[0], leaves[1])) > 20 and len(np.setdiff1d(leaves[1], leaves[0])) == 0, "hidden"
    assert len(np.setdiff1d(leaves[2], leaves[1])) > 20 and len(np.setdiff1d(leaves[1], leaves[2])) > 20, "deformed"
    assert len(np.setdiff1d(leaves[3], leaves[2])) > 20, "another instance"


def scattered(item: bpy.types.Object) -> None:
    """A second instance of `item` from frame 4 on, by geometry nodes."""
    tree, given, made = geometry_nodes(item)
    line, place = tree.nodes.new("GeometryNodeMeshLine"), tree.nodes.new("GeometryNodeInstanceOnPoints")
    line.inputs["Offset"].default_value = (0.0, 0.4, 0.0)
    for frame, count in ((1, 1), (3, 1), (4, 2)):
        line.inputs["Count"].default_value = count
        line.inputs["Count"].keyframe_insert("default_value", frame=frame)
    tree.links.new(line.outputs[0], place.inputs["Points"])
    tree.links.new(given, place.inputs["Instance"])
    tree.links.new(place.outputs[0], made)


def test_finished_frames_are_skipped(tmp_path: Path, weights: Path) -> None:
    bake(tmp_path, weights, (1, 2))
    written = (tmp_path / "frame-0002" / "octree.safetensors").stat().st_mtime_ns
    result = bake(tmp_path, weights)
    assert (result.made, result.skipped) == ([3], [1, 2])
    assert [entry["frame"] for entry in result.report["frames"]] == [1, 2, 3]
    assert (tmp_path / "frame-0002" / "octree.safetensors").stat().st_mtime_ns == written
    alone = bake(tmp_path, weights, (2,))
    assert (alone.made, alone.skipped) == ([], [2]), "its exposure is still that of frame 1"
    assert bake(tmp_path, weights).skipped == [1, 2, 3]
    assert bake(tmp_path, weights, overwrite=True).made == [1, 2, 3]


def test_what_is_not_whole_is_made_again(tmp_path: Path, weights: Path) -> None:
    bake(tmp_path, weights)
    (tmp_path / "frame-0001" / "Eye" / "refined.png").unlink()
    (tmp_path / "frame-0002" / "frame.json").write_text("{")
    content = (tmp_path / "frame-0003" / "octree.safetensors").read_bytes()
    (tmp_path / "frame-0003" / "octree.safetensors").write_bytes(content[:-1])
    (tmp_path / "frame-0003" / "notes.txt").write_text("mine")
    assert bake(tmp_path, weights).made == [1, 2, 3]
    assert (tmp_path / "frame-0003" / "notes.txt").read_text() == "mine"


def test_other_settings_and_other_scenes_are_not_reused(
    tmp_path: Path, weights: Path, tmp_path_factory: pytest.TempPathFactory, scene: bpy.types.Scene
) -> None:
    bake(tmp_path, weights, cameras=("Eye",))
    assert bake(tmp_path, weights, cameras=("Eye",), budget=0.5).made == [1, 2, 3]
    assert report(tmp_path, 2)["frames"][0]["budget"] == 0.5
    other = random_weights(tmp_path_factory.mktemp("same"))
    assert bake(tmp_path, other, cameras=("Eye",), budget=0.5).skipped == [1, 2, 3], "the same weights elsewhere"
    keyed(bpy.data.objects["Lath 0"], "location", {2: (0, 0, 0), 3: (0, 0, 0.1)})
    assert bake(tmp_path, weights, cameras=("Eye",), budget=0.5).made == [3], "nothing else has changed at frames 1, 2"
    scene.camera.name = "Other"
    assert bake(tmp_path, weights, cameras=("Other",), budget=0.5).made == [1, 2, 3]
    assert not (tmp_path / "frame-0001" / "Eye").exists(), "pictures of a camera that is gone"


def test_one_grid_for_all_frames(tmp_path: Path, weights: Path, scene: bpy.types.Scene) -> None:
    keyed(bpy.data.objects["Slab"], "location", {1: (0, 0, 0), 3: (0, 4, 0)})
    before = scene_snapshot()
    bake(tmp_path / "own", weights)
    bake(tmp_path / "one", weights, one_grid=True, depth=None)
    assert_unchanged(before)
    own = {octree(tmp_path / "own", frame).grid for frame in (1, 2, 3)}
    one = {octree(tmp_path / "one", frame).grid for frame in (1, 2, 3)}
    assert len(own) == 3 and len(one) == 1
    (grid,) = one
    assert grid.side_world > max(each.side_world for each in own) * 0.99


def test_edits_without_keys_stay(tmp_path: Path, weights: Path, scene: bpy.types.Scene) -> None:
    slab, shader = bpy.data.objects["Slab"], bpy.data.materials["Slab"].node_tree.nodes["Principled BSDF"]
    slab["dial"] = 1.0
    slab.keyframe_insert('["dial"]', frame=1)
    shader.inputs["Roughness"].keyframe_insert("default_value", frame=1)
    slab["dial"], slab.location.y, shader.inputs["Roughness"].default_value = 2.5, 0.125, 0.75
    bpy.context.view_layer.update()
    before = scene_snapshot()
    bake(tmp_path, weights, (1, 3))
    assert_unchanged(before)
    assert (slab["dial"], slab.location.y, shader.inputs["Roughness"].default_value) == (2.5, 0.125, 0.75)
    assert slab.matrix_world.translation.y == 0.125


def test_stopping_and_failing_leave_the_scene_as_it_was(tmp_path: Path, weights: Path, scene: bpy.types.Scene) -> None:
    before = scene_snapshot()
    maker = JobMaker(JobSettings.of(weights=weights, **QUICK))
    steps = bake_frames(bpy.context, maker, FramePlan((1, 2, 3), tmp_path))
    label = ""
    while label != "Frame 3, 3 of 3: Encoding":
        progress = next(steps)
        label = progress.label
    assert scene.frame_current == 3 and progress.whole is not None and 2 / 3 <= progress.whole < 1
    steps.close()
    assert_unchanged(before)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frame-0001", "frame-0002", "report.json"]
    assert not json.loads((tmp_path / "report.json").read_text())["complete"]
    for item in bpy.data.objects:
        if item.type == "MESH":
            keyed(item, "hide_render", {1: False, 3: True})
    before = scene_snapshot()
    with pytest.raises(PatchNetError, match="Frame 3: No visible object"):
        bake(tmp_path, weights)
    assert_unchanged(before)
    with pytest.raises(PatchNetError, match="Frame 3: No visible object"):
        bake(tmp_path, weights, one_grid=True)
    assert_unchanged(before)
    assert bake(tmp_path, weights, (1, 2)).skipped == [1, 2]


def test_operator(tmp_path: Path, scene: bpy.types.Scene) -> None:
    assert bpy.ops.patchnet.run_all(**QUICK) == {"FINISHED"}
    drop_result_images()
    before, kept = scene_snapshot(), results.result_of(scene)
    bpy.context.view_layer.update()
    kept.reasons.clear()  # to ask for everything changes something, too
    assert bpy.ops.patchnet.bake_animation(frame_end=2, out=str(tmp_path), **QUICK) == {"FINISHED"}
    assert_unchanged(before)
    assert results.result_of(scene) is kept and not kept.stale, "the scene's own result is still there and fits"
    times = [(tmp_path / f"frame-000{n}" / "octree.safetensors").stat().st_mtime_ns for n in (1, 2)]
    scene.patchnet.out = str(tmp_path)
    assert bpy.ops.patchnet.bake_animation(**QUICK) == {"FINISHED"}
    assert times == [(tmp_path / f"frame-000{n}" / "octree.safetensors").stat().st_mtime_ns for n in (1, 2)]
    assert (tmp_path / "frame-0003" / "frame.json").exists()
    assert bpy.ops.patchnet.bake_animation(skip_existing=False, frame_end=1, **QUICK) == {"FINISHED"}
    assert times[0] < (tmp_path / "frame-0001" / "octree.safetensors").stat().st_mtime_ns
    with pytest.raises(RuntimeError, match="before the first"):
        bpy.ops.patchnet.bake_animation(frame_start=5, frame_end=2)
    scene.patchnet.out = ""
    with pytest.raises(RuntimeError, match="choose the output folder"):
        bpy.ops.patchnet.bake_animation()


def test_light_is_only_added_where_no_frame_has_any(tmp_path: Path, weights: Path, scene: bpy.types.Scene) -> None:
    bpy.data.objects.remove(bpy.data.objects["Lamp"])
    result = bake(tmp_path, weights, (1, 2), **LIT)
    assert any(text.startswith("Frame 1 and 1 more: The scene has no light") for text in result.warnings)
    assert result.report["daylight"] is True and octree(tmp_path, 2).luminance.max() > 0.5


def test_frames_of_equal_surface_share_voxels(
    tmp_path: Path, weights: Path, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An object that moves in some frames: each of its places is lit once, with a camera that stands still or moves."""
    lit = frames_of_calls(monkeypatch, run, "light_octree")
    bpy.data.objects["Slab"].animation_data_clear()
    places = {2: (0, 0, 0), 4: (0, -0.8, 0), 5: (0, -0.8, 0), 7: (0, 0, 0)}
    keyed(bpy.data.objects["Slab"], "location", places)
    wanted = {**LIT, "depth": None, "size": (48, 32)}
    made = bake(tmp_path / "still", weights, frames=range(1, 9), **wanted)
    assert lit == [1, 3, 4, 6] and made.sentence() == "8 frames made with the voxels of 4"
    assert [frame["voxels_of"] for frame in made.report["frames"]] == [1, 1, 3, 4, 4, 6, 1, 1]
    alone = bake(tmp_path / "alone", weights, frames=(5,), exposure=made.report["exposure"], **wanted)
    assert alone.sentence() == "1 frame made"
    whole, part = (tmp_path / name / "frame-0005" for name in ("still", "alone"))
    names = sorted(path.relative_to(whole) for path in whole.rglob("*.png"))
    assert len(names) > 3 and all((whole / name).read_bytes() == (part / name).read_bytes() for name in names)
    lit.clear()
    keyed(scene.camera, "location", {1: scene.camera.location[:], 6: scene.camera.location + Vector((0.3, 0.0, 0.0))})
    bake(tmp_path / "moving", weights, frames=range(1, 8), track=True, track_frames=(1, 7), **wanted)
    assert lit == [1, 3, 4, 6]
    lit.clear()
    bake(tmp_path / "own", weights, frames=range(1, 7), **wanted)
    assert lit == [1, 2, 3, 4, 5, 6], "each fitted to its camera"


def _shadow(scene: bpy.types.Scene) -> None:
    keyed(bpy.data.objects["Slab"], "visible_shadow", {1: True, 3: False})


def _bounces(scene: bpy.types.Scene) -> None:
    for frame, bounces in ((1, 4), (2, 4), (3, 0)):
        scene.cycles.max_bounces = bounces
        scene.keyframe_insert("cycles.max_bounces", frame=frame)


def _volume(scene: bpy.types.Scene) -> None:
    _rises(bpy.data.objects.new("Smoke", bpy.data.volumes.new("Smoke")))


def _caster(scene: bpy.types.Scene) -> None:
    caster = bpy.data.objects.new("Caster", bpy.data.objects["Slab"].data)
    caster.visible_camera = False
    _rises(caster)


def _rises(item: bpy.types.Object) -> None:
    bpy.context.scene.collection.objects.link(item)
    keyed(item, "location", {1: (0.0, 0.0, 2.0), 2: (0.0, 0.0, 2.0), 3: (0.0, 0.0, 3.0)})


@pytest.mark.parametrize("change", [_shadow, _bounces, _volume, _caster])
def test_what_changes_light_alone_is_another_light(
    change: Callable[[bpy.types.Scene], None],
    tmp_path: Path,
    weights: Path,
    scene: bpy.types.Scene,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bpy.data.objects["Slab"].animation_data_clear()
    change(scene)
    lit = frames_of_calls(monkeypatch, run, "light_octree")
    bake(tmp_path, weights, **LIT)
    assert lit == [1, 3]


def test_frames_of_a_moving_camera_share_the_voxels_of_all_frames(
    tmp_path: Path, weights: Path, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With All Frames; each frame is that of other parts of the animation, to the bit. Else each has its own."""
    bpy.data.objects["Slab"].animation_data_clear()
    keyed(scene.camera, "location", {1: scene.camera.location[:], 3: scene.camera.location + Vector((0.3, 0.0, 0.0))})
    lit = frames_of_calls(monkeypatch, run, "light_octree")
    wanted = {**LIT, "depth": None, "size": (48, 32)}
    bake(tmp_path / "whole", weights, track=True, **wanted)
    assert lit == [1]
    bake(tmp_path / "part", weights, frames=(3,), track=True, **wanted)
    assert lit == [1, 3]
    whole, part = (tmp_path / name / "frame-0003" for name in ("whole", "part"))
    names = sorted(path.relative_to(whole) for path in whole.rglob("*.png"))
    assert len(names) > 3 and all((whole / name).read_bytes() == (part / name).read_bytes() for name in names)
    first = tmp_path / "whole" / "frame-0001"
    assert any((whole / name).read_bytes() != (first / name).read_bytes() for name in names)
    bake(tmp_path / "own", weights, **wanted)
    assert lit == [1, 3, 1, 2, 3]
    keyed(scene.camera, "location", {3: scene.camera.location[:]})
    assert bake(tmp_path / "whole", weights, frames=(1,), track=True, **wanted).made == [1], "another track"
