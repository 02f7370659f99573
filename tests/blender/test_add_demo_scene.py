# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scene as users add it to a file of their own: all of it is there, nothing else changes, undo removes it."""

import bpy
import pytest

from patchnet.operators.add_demo_scene import NAME
from patchnet.operators.jobs.job_operator import JobOperator
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("scene")


def test_a_scene_of_its_own_is_shown_and_selected() -> None:
    mine = bpy.context.scene
    before = scene_snapshot()
    assert bpy.ops.patchnet.add_demo_scene() == {"FINISHED"}
    shown = bpy.context.window.scene
    assert shown.name == NAME and shown.camera.name == "Middle" and shown.world is not None
    assert len(shown.objects) > 50
    assert {item for item in shown.view_layers[0].objects if item.select_get()} == set(shown.view_layers[0].objects)
    assert not set(shown.objects) & set(mine.objects)
    views = [area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D"]
    assert "CAMERA" in [area.spaces.active.region_3d.view_perspective for area in views]
    bpy.context.window.scene = mine
    bpy.data.scenes.remove(shown)
    bpy.data.orphans_purge(do_recursive=True)
    assert_unchanged(before)


def test_undo_removes_it() -> None:
    bpy.ops.ed.undo_push(message="before")
    names = {item.name for item in bpy.data.objects}
    bpy.ops.patchnet.add_demo_scene()
    bpy.ops.ed.undo_push(message="added")  # as Blender does after an operator in a window
    bpy.ops.ed.undo()
    assert NAME not in bpy.data.scenes and {item.name for item in bpy.data.objects} == names
    bpy.ops.ed.redo()
    assert len(bpy.data.scenes[NAME].objects) > 50


def test_it_waits_for_jobs_and_for_object_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(JobOperator, "running", "Bake Light")
    with pytest.raises(RuntimeError, match="Bake Light is running"):
        bpy.ops.patchnet.add_demo_scene()
    monkeypatch.undo()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode only"):
        bpy.ops.patchnet.add_demo_scene()
    bpy.ops.object.mode_set(mode="OBJECT")
