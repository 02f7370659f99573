# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss that a camera sees is outdated when that camera moves, and only then."""

import shutil
from pathlib import Path

import bpy
import pytest

from patchnet.operators.render_engine import render_frame
from patchnet.operators.session import octree_cache
from patchnet.operators.session.staleness import look_again
from patchnet.operators.state.block_hashes import GLOSS_MOVED, place_of_gloss
from patchnet.operators.ui.tab import stale_text
from patchnet.tests.blender.job_scene import principled, result, saved

pytestmark = pytest.mark.usefixtures("scene")
QUICK = {"light": "cycles", "max_samples": 2, "depth": 5, "size": (16, 12)}
ADVICE = "The camera that gloss is seen from moved: bake again"


def metal() -> None:
    principled("Slab").inputs["Metallic"].default_value = 1.0


def run(**values: object) -> None:
    assert bpy.ops.patchnet.run_all(**{**QUICK, **values}) == {"FINISHED"}


def shift(x: float = 0.5) -> None:
    bpy.data.objects["Eye"].location.x += x
    bpy.context.view_layer.update()


def test_a_camera_that_moves_makes_gloss_stale_until_it_is_baked_again() -> None:
    metal()
    run()
    bpy.data.objects["Eye"].rotation_euler.z += 0.1  # reflections of what stands still are the same
    bpy.context.view_layer.update()
    assert result().stale == set()
    shift()
    assert result().stale == {"light"} and result().is_stale_by_gloss_alone
    assert stale_text(result(), bpy.context.scene, "light") == ADVICE
    shift(-0.5)
    look_again(result(), bpy.context.scene)
    assert result().stale == set(), "moved back"
    shift()
    octree = result().octree
    assert bpy.ops.patchnet.bake_light(light="cycles", max_samples=2) == {"FINISHED"}
    assert result().octree is not octree and result().stale == set()
    shift(0.1)
    assert result().stale == {"light"}, "seen from where it was baked last"


@pytest.mark.parametrize("case", ["no metal", "seen from above", "gloss off", "two lights", "another light"])
def test_what_does_not_depend_on_the_camera_stays(case: str) -> None:
    if case != "no metal":
        metal()
    values = {
        "seen from above": {"gloss": "above"},
        "gloss off": {"gloss": "off"},
        "two lights": {"light": "two-lights"},
    }
    run(**values.get(case, {}))
    if case == "another light":
        bpy.data.lights["Lamp"].energy = 9.0
        bpy.context.view_layer.update()
        assert result().stale == {"light"} and not result().is_stale_by_gloss_alone
        return
    shift()
    assert result().stale == set()


def test_orthographic_cameras_look_from_a_direction() -> None:
    scene, eye = bpy.context.scene, bpy.data.objects["Eye"]
    before = place_of_gloss(scene)
    eye.data.type = "ORTHO"
    first = place_of_gloss(scene)
    eye.location.x += 1.0
    assert before != first == place_of_gloss(scene)
    eye.rotation_euler.z += 0.1
    bpy.context.view_layer.update()
    assert place_of_gloss(scene) != first
    eye.constraints.new("LIMIT_LOCATION")
    assert place_of_gloss(scene) != first


def test_the_engine_shows_the_gloss_that_is_there_and_says_so(
    monkeypatch: pytest.MonkeyPatch, bakes: list[str]
) -> None:
    """A bake for each place of the camera would be a bake for each frame."""
    metal()
    run()
    said: list[str] = []
    monkeypatch.setattr(render_frame, "warn", lambda _, text: said.append(text))
    bakes.clear()
    scene = bpy.context.scene
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PATCHNET", 8, 8
    bpy.ops.render.render()
    assert not any("Gloss" in text for text in said)
    shift()
    octree = result().octree
    bpy.ops.render.render()
    assert any("place during the bake" in text for text in said)
    assert result().octree is octree and result().stale == {"light"} and not bakes


def test_an_animation_has_one_gloss_in_all_frames(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, bakes: list[str], light_of_its_own: Path
) -> None:
    """Automatic sees it from above there, also in the frame that a still with its camera's gloss was made of.

    But where the camera has no keys: then all frames have the gloss that it sees, and what was baked.
    """
    metal()
    run()
    still, said = result(), []
    bakes.clear()
    monkeypatch.setattr(render_frame, "warn", lambda _, text: said.append(text))
    scene = bpy.context.scene
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PATCHNET", 8, 8
    scene.frame_start, scene.frame_end = scene.frame_current, scene.frame_current + 1
    scene.render.filepath = str(tmp_path / "picture")
    bpy.ops.render.render(animation=True)
    assert not bakes and not any("Gloss" in text for text in said) and result() is still
    bpy.data.objects["Eye"].keyframe_insert("location")
    bpy.ops.render.render(animation=True)
    count = len(bakes)
    assert count and not any("Gloss" in text for text in said) and result() is still
    scene.frame_end += 2
    shutil.rmtree(light_of_its_own)
    bpy.ops.render.render(animation=True)
    assert len(bakes) == 2 * count, "once for all frames"
    scene.patchnet.gloss = "camera"
    run(gloss="camera")
    bpy.ops.render.render(animation=True)
    assert any("place during the bake" in text for text in said)


def test_files_know_from_where_gloss_was_seen(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An octree that is found again when the file is opened, and one that is loaded."""
    monkeypatch.setenv("PATCHNET_KEEP", "1")
    monkeypatch.setenv("PATCHNET_CACHE", str(cache))
    metal()
    run(out=str(tmp_path / "out"))
    octree = str(tmp_path / "out" / "octree.safetensors")
    for moved in (False, True):
        if moved:
            shift()
        path = saved(tmp_path / f"scene-{moved}.blend")
        bpy.ops.wm.open_mainfile(filepath=str(path))
        found = octree_cache.result_or_kept(bpy.context.scene)
        assert found is not None and found.stale == ({"light"} if moved else set())
        assert bpy.ops.patchnet.load_octree(filepath=octree) == {"FINISHED"}
        assert result().stale == ({"light"} if moved else set())
        assert (GLOSS_MOVED in result().why("light")) == moved
