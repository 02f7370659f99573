# SPDX-License-Identifier: GPL-3.0-or-later
"""Octrees and codes are loaded from the cache when a file is opened again."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.cache import clear_cache
from patchnet.operators.session import octree_cache, results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.operators.session.staleness import look_again
from patchnet.tests.blender.job_scene import SMALL, build, saved
from patchnet.tests.blender.objects import slid

CYCLES = {"light": "cycles", "max_samples": 2, **SMALL}


@pytest.fixture
def file(scene: bpy.types.Scene, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The small scene as a file, lit by Cycles and encoded, and a cache folder of its own that keeps octrees."""
    monkeypatch.setenv("PATCHNET_KEEP", "1")
    monkeypatch.setenv("PATCHNET_CACHE", str(cache))
    path = saved(tmp_path / "scene.blend")
    assert bpy.ops.patchnet.run_all(**CYCLES) == {"FINISHED"}
    return path


def reopen(path: Path) -> SceneResult | None:
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert results.result_of(bpy.context.scene) is None
    return octree_cache.result_or_kept(bpy.context.scene)


def test_result_is_there_when_the_file_is_opened_again(file: Path, bakes: list[str]) -> None:
    before = results.voxels_of(bpy.context.scene)
    after = reopen(file)
    assert after is not None and after.octree is not before.octree and after.stale == set()
    np.testing.assert_array_equal(after.octree.luminance, before.octree.luminance)
    np.testing.assert_array_equal(after.coded.codes, before.coded.codes)
    assert (after.light, after.scope, after.encoder) == (before.light, before.scope, before.encoder)
    assert after.made_with == before.made_with
    assert bpy.ops.patchnet.render_preview(size=(24, 16)) == {"FINISHED"}
    assert len([image for image in bpy.data.images if "patchnet_result" in image]) == 11
    scene = bpy.context.scene
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PATCHNET", 8, 8
    bpy.ops.render.render()
    assert results.voxels_of(scene).octree is after.octree and not bakes


def test_preview_selection_finds_what_fitted_the_scene_before(file: Path, bakes: list[str]) -> None:
    before, lamp = results.voxels_of(bpy.context.scene), bpy.data.lights["Lamp"]
    energy, lamp.energy = lamp.energy, 9.0
    assert bpy.ops.patchnet.run_all(**CYCLES) == {"FINISHED"}
    assert results.voxels_of(bpy.context.scene).octree.exposure == pytest.approx(before.octree.exposure / 3, rel=1e-3)
    lamp.energy = energy
    bakes.clear()
    assert bpy.ops.patchnet.run_all(**CYCLES) == {"FINISHED"}
    after = results.voxels_of(bpy.context.scene)
    np.testing.assert_array_equal(after.octree.luminance, before.octree.luminance)
    assert after.octree.exposure == before.octree.exposure and after.stale == set() and not bakes


def test_what_no_file_saves_does_not_matter(file: Path, cache: Path) -> None:
    """Blocks without users, as deleted objects leave them, are there when the octree is made, and not in the file."""
    clear_cache(cache)
    bpy.ops.patchnet.clear_results()
    bpy.data.meshes.new("left over").materials.append(bpy.data.materials.new("left over"))
    assert bpy.ops.patchnet.run_all(**CYCLES) == {"FINISHED"}
    assert reopen(saved(file)) is not None
    assert "left over" not in bpy.data.meshes


def test_another_scene_finds_nothing(file: Path, tmp_path: Path) -> None:
    bpy.data.meshes["Slab"].vertices[0].co.x = -1.2
    assert reopen(saved(tmp_path / "changed.blend")) is None
    assert reopen(file) is not None


def test_codes_of_other_weights_stay_where_they_are(file: Path) -> None:
    bpy.context.scene.patchnet.weights = ""
    bpy.ops.wm.save_mainfile()
    result = reopen(file)
    assert result is not None and result.coded is None


def test_damage_is_a_result_that_is_not_there(file: Path, tmp_path: Path) -> None:
    (octree,) = (tmp_path / "cache").glob("octrees/*/octree.safetensors")
    content = bytearray(octree.read_bytes())
    content[-3] ^= 0xFF
    octree.write_bytes(content)
    assert reopen(file) is None and not octree.exists()


def test_a_frame_of_an_animation_finds_what_was_baked_for_it(file: Path, tmp_path: Path, bakes: list[str]) -> None:
    """Also where the file was saved at another frame."""
    scene = bpy.context.scene
    slid(bpy.data.objects["Lath 2"], {1: 0.1, 9: 0.9}, axis=2)
    values = scene.patchnet
    values.light, values.samples, values.resolution, values.depth, values.gloss = "cycles", 1, "DEPTH", 5, "off"
    scene.frame_set(5)
    assert bpy.ops.patchnet.run_all(size=(24, 16)) == {"FINISHED"}
    scene.frame_set(1)
    bpy.ops.wm.open_mainfile(filepath=str(saved(file)))
    scene = bpy.context.scene
    bakes.clear()
    scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PATCHNET", 8, 8
    scene.render.filepath = str(tmp_path / "picture")
    for frame in (5, 6):
        scene.frame_start = scene.frame_end = frame
        bpy.ops.render.render(animation=True)
        assert bool(bakes) == (frame == 6)


def test_what_could_move_but_does_not_is_baked_once_for_all_processes(
    file: Path, tmp_path: Path, bakes: list[str]
) -> None:
    """A driver may change at any frame; a frame alone in a process of its own finds what an equal one shows."""
    lath = bpy.data.objects["Lath 2"]
    lath.driver_add("location", 2).driver.expression = "0.2 if frame > 5 else 0.0"
    values = bpy.context.scene.patchnet
    values.light, values.max_samples, values.resolution, values.depth, values.gloss = "cycles", 2, "DEPTH", 5, "off"
    path = saved(file)
    for frame, baked in ((1, True), (4, False), (7, True), (9, False), (2, False)):
        bpy.ops.wm.open_mainfile(filepath=str(path))
        scene = bpy.context.scene
        scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "PATCHNET", 8, 8
        scene.render.filepath = str(tmp_path / "picture")
        bakes.clear()
        scene.frame_set(frame)
        bpy.ops.render.render(write_still=True)
        assert bool(bakes) == baked, frame


@pytest.mark.usefixtures("registered")
def test_octree_file_becomes_the_scenes_voxels(tmp_path: Path, weights: Path) -> None:
    build()
    scene = bpy.context.scene
    scene.patchnet.weights = str(weights)
    assert bpy.ops.patchnet.run_all(light="two-lights", **SMALL, out=str(tmp_path / "out")) == {"FINISHED"}
    before = results.voxels_of(scene)
    bpy.ops.patchnet.clear_results()
    path = str(tmp_path / "out" / "octree.safetensors")
    assert bpy.ops.patchnet.load_octree(filepath=path) == {"FINISHED"}
    after = results.voxels_of(scene)
    np.testing.assert_array_equal(after.octree.luminance, before.octree.luminance)
    np.testing.assert_array_equal(after.coded.codes, before.coded.codes)
    assert after.light == "two-lights" and after.stale == set()
    bpy.data.objects["Slab"].location.x += 0.2
    bpy.context.view_layer.update()
    look_again(after, scene)
    assert after.stale == {"surface"}
    assert bpy.ops.patchnet.load_octree(filepath=path) == {"FINISHED"}
    assert results.voxels_of(scene).stale == {"surface", "light"}
    assert "another scene" in results.voxels_of(scene).why("surface")


@pytest.mark.usefixtures("scene")
@pytest.mark.parametrize(
    ("filepath", "message"),
    [("", "No file to load"), ("/nowhere/octree.safetensors", "does not exist"), (__file__, "not a PatchNet file")],
)
def test_files_that_are_no_octrees(filepath: str, message: str) -> None:
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.patchnet.load_octree(filepath=filepath)
    assert results.result_of(bpy.context.scene) is None
