# SPDX-License-Identifier: GPL-3.0-or-later
"""A file saved during a job contains nothing of the job."""

from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from patchnet.operators.cycles.pixel_renders import pixel_renders
from patchnet.operators.scene_access.frames import kept_frame
from patchnet.operators.scene_access.overrides import changed
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.blender.full_scene import build_full
from patchnet.tests.blender.light_scene import lit, on_bake
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("registered")


def save(path: Path) -> Path:
    assert bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True) == {"FINISHED"}
    return path


def assert_same_file(before: Path, after: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(before))
    snapshot = scene_snapshot()
    bpy.ops.wm.open_mainfile(filepath=str(after))
    assert_unchanged(snapshot)


def link_light() -> None:
    """The lamp shines on one object alone."""
    receivers = bpy.data.collections.new("Receivers")
    receivers.objects.link(bpy.data.objects["Slab"])
    bpy.data.objects["Lamp"].light_linking.receiver_collection = receivers


def remove_light() -> None:
    """Cycles bakes in daylight of ours."""
    bpy.data.objects.remove(bpy.data.objects["Lamp"])
    bpy.context.scene.world = None


@pytest.mark.parametrize("prepare", [link_light, remove_light])
def test_saved_while_cycles_bakes(prepare: Callable[[], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build_full(tmp_path, "EDIT")
    bpy.ops.object.mode_set(mode="OBJECT")
    prepare()
    bpy.context.view_layer.update()
    before, saves = save(tmp_path / "before.blend"), []
    on_bake(monkeypatch, lambda _target: saves.append(save(tmp_path / f"{len(saves)}.blend")))
    lit(depth=4, size=(16, 16), max_samples=2)
    assert saves
    for path in saves:
        assert_same_file(before, path)


def test_saved_while_cycles_renders_regions(tmp_path: Path) -> None:
    build_full(tmp_path, "OBJECT")
    bpy.data.objects["Lamp"].visible_camera = True
    before = save(tmp_path / "before.blend")
    camera = Camera.look_at((0, -5, 0), (0, 0, 0), fov=1.0, size_px=(16, 16), name="Eye")
    with pixel_renders(bpy.context, camera, "diffuse", sun=True) as renders:
        drain(renders.picture(1, 0, "Cycles"))
        assert not bpy.data.objects["Lamp"].visible_camera
        saved = save(tmp_path / "after.blend")
        assert not bpy.data.objects["Lamp"].visible_camera, "the job goes on as before"
    assert_same_file(before, saved)


def test_saved_at_another_frame(tmp_path: Path) -> None:
    build_full(tmp_path, "OBJECT")
    scene = bpy.context.scene
    before, frame = save(tmp_path / "before.blend"), scene.frame_current
    with kept_frame(scene):
        scene.frame_set(frame + 3)
        saved = save(tmp_path / "after.blend")
        assert scene.frame_current == frame + 3
    assert scene.frame_current == frame
    assert_same_file(before, saved)


def test_a_save_that_fails_leaves_the_job_alone(tmp_path: Path) -> None:
    build_full(tmp_path, "OBJECT")
    lamp = bpy.data.objects["Lamp"]
    lamp.visible_camera = True
    with changed(lamp, visible_camera=False):
        with pytest.raises(RuntimeError):
            save(tmp_path / "missing" / "after.blend")
        assert not lamp.visible_camera
    assert lamp.visible_camera
