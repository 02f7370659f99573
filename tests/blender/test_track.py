# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a track: of the file as saved or of its own, the same for all chunks; kept as long as its cameras are."""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.pipeline import lit_octree
from patchnet.operators.render_engine import frame_octree
from patchnet.operators.scene.cameras import camera_size_px
from patchnet.operators.scene.track import kept_track, track_cameras, track_frames
from patchnet.operators.session import results
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.image.exr import read_exr
from patchnet.patchnet_addon.octree.file import load_octree, octree_arrays
from patchnet.patchnet_addon.runtime.errors import SceneError, SettingError
from patchnet.tests.blender.engine_scene import build_for_engine, kept, passes_in
from patchnet.tests.blender.job_scene import QUICK, frames_of_calls, saved
from patchnet.tests.blender.objects import new_camera, slid

PASSES = "Combined", "Level", "Depth"


@pytest.fixture
def walk(
    registered: None, weights: Path, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> bpy.types.Scene:
    """The open file of a camera that moves through four frames, with All Frames."""
    monkeypatch.setenv("PATCHNET_KEEP", "1")
    monkeypatch.setenv("PATCHNET_CACHE", str(cache))
    scene = build_for_engine(weights, tmp_path)
    scene.patchnet.resolution, scene.patchnet.track = "AUTO", True
    scene.objects["Slab"].scale, scene.camera.data.lens = (0.25, 1.0, 0.25), 480.0
    scene.frame_start, scene.frame_end = 1, 4
    slid(scene.camera, {1: 0.3, 4: 0.6})
    return opened(saved(tmp_path / "walk.blend"))


def opened(path: Path) -> bpy.types.Scene:
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


def pictures(scene: bpy.types.Scene, name: str) -> dict[int, dict[str, np.ndarray]]:
    """Passes of all frames that the scene renders."""
    folder = Path(scene.render.filepath).parent
    scene.render.filepath = str(folder / name) + "-"
    assert bpy.ops.render.render(animation=True) == {"FINISHED"}
    numbers = range(scene.frame_start, scene.frame_end + 1)
    return {number: passes_in(folder / f"{name}-{number:04d}.exr") for number in numbers}


def test_chunks_have_the_voxels_of_the_whole_track(walk: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process for each, which sets frames of its own; the first makes them, the others find them."""
    made = frames_of_calls(monkeypatch, frame_octree, "build_lit_octree")
    path = Path(bpy.data.filepath)
    whole = pictures(walk, "whole")
    assert made == [1]
    leaves = kept(walk).octree.leaf_count
    for first, last in ((3, 4), (1, 2)):
        scene = opened(path)
        scene.frame_start, scene.frame_end = first, last
        for number, chunk in pictures(scene, f"chunk-{first}").items():
            for name in PASSES:
                assert np.array_equal(chunk[name], whole[number][name]), (number, name)
    assert made == [1]
    scene = opened(path)
    scene.patchnet.track_frames = 3, 4
    pictures(scene, "own")
    assert made == [1, 1] and kept(scene).octree.leaf_count < leaves


def test_all_ways_show_the_same_pixels(
    walk: bpy.types.Scene, weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An animation, a frame after Preview Selection and of `patchnet run`, of pictures of one size."""
    path, size = Path(bpy.data.filepath), camera_size_px(walk)
    whole = pictures(walk, "whole")[3]
    octree = kept(walk).octree
    monkeypatch.setenv("PATCHNET_KEEP", "0")  # each makes them
    scene = opened(path)
    assert bpy.ops.patchnet.run_all(scope="VISIBLE", size=size) == {"FINISHED"}
    scene.frame_start = scene.frame_end = 3
    panel = pictures(scene, "panel")[3]
    for name in PASSES:
        assert np.array_equal(panel[name], whole[name]), name
    words = ["run", str(path), "--weights", str(weights), "--light", "two-lights", "--depth", "auto", "--track"]
    words += ["--size", *map(str, size), "--refined-samples", "1024", "--scope", "visible", "--frames", "3"]
    assert commands.main([*words, "--out", str(tmp_path / "run")]) == 0
    folder = tmp_path / "run" / "frame-0003"
    by_run = octree_arrays(load_octree(folder / "octree.safetensors"))
    for name, values in octree_arrays(octree).items():
        np.testing.assert_array_equal(by_run[name], values, name)
    (priority,) = folder.rglob("priority.exr")
    np.testing.assert_array_equal(read_exr(priority)["R"], whole["Priority"][..., 0])


@pytest.mark.parametrize("first", range(4))
def test_voxels_made_in_one_way_are_found_in_all(
    walk: bpy.types.Scene, weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: int
) -> None:
    """Each opens the file as a process of its own does."""
    values = walk.patchnet
    values.light, values.max_samples, values.size = "cycles", 2, camera_size_px(walk)
    path, built = saved(Path(bpy.data.filepath)), []
    build = lit_octree.build_octree
    monkeypatch.setattr(lit_octree, "build_octree", lambda *given: built.append(1) or build(*given))
    words = ["run", str(path), "--weights", str(weights), "--size", *map(str, values.size), "--max-samples", "2"]
    words += ["--track", "--out"]
    ways = [
        lambda: commands.main([*words, str(tmp_path / "run")]),
        lambda: commands.main([*words, str(tmp_path / "frames"), "--frames", "3"]),
        lambda: pictures(bpy.context.scene, "engine"),
        lambda: bpy.ops.patchnet.run_all(scope="VISIBLE"),
    ]
    for way in (ways[first], *ways):
        opened(path)
        way()
        assert len(built) == 1, ways.index(way)


def test_another_path_of_the_camera_gets_other_voxels(walk: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    made = frames_of_calls(monkeypatch, frame_octree, "build_lit_octree")
    pictures(walk, "before")
    slid(walk.camera, {1: 0.3, 4: 0.9})
    path = saved(Path(bpy.data.filepath))
    pictures(opened(path), "after")
    assert made == [1, 1]


def test_frames_of_a_track(walk: bpy.types.Scene) -> None:
    scene = walk
    scene.frame_start, scene.frame_end, scene.frame_step = 2, 3, 5
    assert track_frames(scene) == range(1, 5), "of the file"
    assert track_frames(scene, (0, 9)) == range(10)
    names = [camera.name for camera in track_cameras(scene, (), (24, 16), (2, 3))]
    assert names == ["Eye, frame 2", "Eye, frame 3"]
    still = new_camera("Still")
    both = track_cameras(scene, ("all",), (24, 16), (2, 3))
    assert [camera.name for camera in both] == ["Eye, frame 2", "Still, frame 2", "Eye, frame 3"]
    scene.timeline_markers.new("eye", frame=2).camera = scene.camera
    scene.timeline_markers.new("still", frame=3).camera = still
    cut = track_cameras(scene, (), (24, 16), (1, 4))
    assert [camera.name for camera in cut] == ["Eye, frame 1", "Eye, frame 2", "Still, frame 3"]
    scene.timeline_markers.clear()
    scene.camera = None
    with pytest.raises(SceneError, match="no camera"):
        track_cameras(scene, (), (24, 16))
    with pytest.raises(SettingError, match="before the first"):
        JobSettings.of(track=True, track_frames=(5, 2))


def test_the_scenes_own_frames_count_where_no_file_was_opened(registered: None, scene: bpy.types.Scene) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 7, 9
    assert track_frames(scene) == range(7, 10)


def test_a_scene_may_go_while_its_track_is_kept(registered: None) -> None:
    """As one whose film Blender renders beside the window."""
    film = bpy.data.scenes.new("Film")
    with kept_track(film):
        bpy.data.scenes.remove(film)


def test_a_checkbox_keeps_the_frames_of_the_scene(walk: bpy.types.Scene) -> None:
    values = walk.patchnet
    assert not values.use_track_frames
    values.use_track_frames = True
    assert tuple(values.track_frames) == (1, 4)
    values.use_track_frames = False
    assert tuple(values.track_frames) == (0, 0)


def test_more_samples_alone_fit_nothing_anew(walk: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    fitted = frames_of_calls(monkeypatch, lit_octree, "fit_cameras")
    call = {"light": "cycles", "size": (24, 16), "scope": "VISIBLE"}
    assert bpy.ops.patchnet.run_all(max_samples=2, **call) == {"FINISHED"}
    layout, count = results.result_of(walk).layout, len(fitted)
    assert bpy.ops.patchnet.run_all(max_samples=4, **call) == {"FINISHED"}
    assert results.result_of(walk).layout is layout and len(fitted) == count
    slid(walk.camera, {1: 0.3, 4: 1.0})
    assert bpy.ops.patchnet.run_all(max_samples=4, **call) == {"FINISHED"}
    assert results.result_of(walk).layout is not layout


def test_the_command_takes_frames(
    walk: bpy.types.Scene, weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", bpy.data.filepath, "--weights", str(weights), *QUICK, "--depth", "auto", "--size", "96", "64"]
    for name, track in (("none", []), ("scene", ["--track"]), ("own", ["--track", "1-2"]), ("all", ["--track", "1-4"])):
        assert commands.main([*words, "--out", str(tmp_path / name), *track]) == 0
    octrees = {name: (tmp_path / name / "octree.safetensors").read_bytes() for name in ("none", "scene", "own", "all")}
    assert octrees["scene"] == octrees["all"] and len(set(octrees.values())) == 3
    assert commands.main(["run", "--track", bpy.data.filepath, "--out", str(tmp_path / "x")]) == 2
    assert commands.main([*words, "--track", "4-1", "--out", str(tmp_path / "x")]) == 2
    assert "before the first" in capsys.readouterr().err


CHUNK = """
import sys, bpy, patchnet
patchnet.register()
path, first, last, name = sys.argv[-4:]
bpy.ops.wm.open_mainfile(filepath=path)
scene = bpy.context.scene
scene.frame_start, scene.frame_end, scene.render.filepath = int(first), int(last), name
bpy.ops.render.render(animation=True)
"""


def test_processes_of_a_farm_bake_once(walk: bpy.types.Scene, cache: Path, tmp_path: Path) -> None:
    """With light by Cycles, which the first process keeps in the cache folder; the others write nothing there."""
    walk.patchnet.light, walk.patchnet.max_samples = "cycles", 2
    path = saved(Path(bpy.data.filepath))
    kept, made = [], {}
    for name, first, last in (("whole", 1, 4), ("one", 1, 1), ("two", 2, 3), ("three", 4, 4)):
        words = [sys.executable, "-c", CHUNK, str(path), str(first), str(last), str(tmp_path / name) + "-"]
        subprocess.run(words, capture_output=True, check=True)
        files = (path for folder in ("octrees", "bakes") for path in (cache / folder).rglob("*") if path.is_file())
        kept.append({path: path.stat().st_mtime_ns for path in files if path.suffix == ".safetensors"})
        made |= {(name, frame): passes_in(tmp_path / f"{name}-{frame:04d}.exr") for frame in range(first, last + 1)}
    assert kept[0] and all(others == kept[0] for others in kept)
    for (name, frame), chunk in made.items():
        for each in PASSES:
            assert np.array_equal(chunk[each], made["whole", frame][each]), (name, frame, each)
