# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake Fly-Through: one bake, the frames that are missing, and what is said before."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.render_engine import fly_through, frame_octree
from patchnet.operators.render_engine.fly_through import FlyThrough
from patchnet.operators.session import results
from patchnet.operators.session.scene_session import session_of
from patchnet.operators.ui.main import PATCHNET_PT_main
from patchnet.tests.blender.drawn import drawn
from patchnet.tests.blender.engine_scene import build_for_engine, passes_in
from patchnet.tests.blender.job_scene import frames_of_calls, saved
from patchnet.tests.blender.objects import slid


@pytest.fixture
def walk(registered: None, weights: Path, tmp_path: Path) -> bpy.types.Scene:
    """A camera that moves through three frames, in a scene that Cycles renders."""
    scene = build_for_engine(weights, tmp_path)
    scene.render.engine, scene.patchnet.resolution, scene.patchnet.render_samples = "CYCLES", "AUTO", 4.0
    scene.frame_start, scene.frame_end = 1, 3
    slid(scene.camera, {1: 0.3, 3: 0.5})
    scene.frame_set(2)
    scene.render.filepath = str(tmp_path / "film" / "picture-")
    return scene


def films(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_one_bake_and_the_missing_frames(
    walk: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames are those of an animation by the engine, and the scene keeps its engine and frame."""
    made = frames_of_calls(monkeypatch, fly_through, "light_octree")
    by_engine = frames_of_calls(monkeypatch, frame_octree, "build_lit_octree")
    assert bpy.ops.patchnet.fly_through() == {"FINISHED"}
    assert not by_engine, "frames show what was baked"
    names = ["picture-0001.exr", "picture-0002.exr", "picture-0003.exr"]
    assert films(tmp_path / "film") == names and len(made) == 1
    assert (walk.render.engine, walk.render.use_overwrite, walk.frame_current) == ("CYCLES", True, 2)
    assert walk.patchnet.track and results.voxels_of(walk).made_by["track"]
    walk.render.engine, walk.render.filepath = "PATCHNET", str(tmp_path / "other" / "picture-")
    bpy.ops.patchnet.clear_results()
    bpy.ops.render.render(animation=True)
    walk.render.engine, walk.render.filepath = "CYCLES", str(tmp_path / "film" / "picture-")
    for name in names:
        one, other = (passes_in(tmp_path / folder / name) for folder in ("film", "other"))
        for each in ("Combined", "Level", "Depth"):
            assert np.array_equal(one[each], other[each]), (name, each)
    made.clear()
    bpy.ops.patchnet.clear_results()
    times = {name: (tmp_path / "film" / name).stat().st_mtime_ns for name in names}
    assert bpy.ops.patchnet.fly_through() == {"FINISHED"}
    assert not made, "all frames are there"
    (tmp_path / "film" / names[1]).unlink()
    assert bpy.ops.patchnet.fly_through() == {"FINISHED"}
    assert len(made) == 1 and films(tmp_path / "film") == names
    now = {name: (tmp_path / "film" / name).stat().st_mtime_ns for name in names}
    assert [now[name] == times[name] for name in names] == [True, False, True]
    (tmp_path / "film" / names[0]).unlink()
    assert bpy.ops.patchnet.fly_through(frame_start=1, frame_end=2) == {"FINISHED"}
    assert len(made) == 1 and films(tmp_path / "film") == names and walk.frame_end == 3, "part of the same track"
    assert len(by_engine) == 1, "that of the animation alone"
    walk.frame_end = 2
    (tmp_path / "film" / names[0]).unlink()
    assert bpy.ops.patchnet.fly_through() == {"FINISHED"}
    assert len(made) == 2, "another track"


def test_what_to_expect_is_said_before(walk: bpy.types.Scene) -> None:
    assert bpy.ops.patchnet.fly_through() == {"FINISHED"}
    lines = session_of(walk).estimate.lines
    assert any(line.startswith("3 frames ") and ": bake about " in line for line in lines)
    assert all(line in drawn(PATCHNET_PT_main) for line in lines)


def test_words() -> None:
    expected = FlyThrough(250, once=90.0, frame=1.0, cycles={8: 5.0, 32: 16.0}, measured=True)
    assert expected.lines() == [
        "250 frames 4 to 8 min: bake about 90 s, a frame 1 s",
        "Cycles, denoised: 15 to 29 min with 8 samples, 48 to 93 min with 32 samples",
        "PatchNet is ahead from 6 frames on of Cycles with 32",
    ]
    never = FlyThrough(2, once=9.0, frame=9.0, cycles={8: 5.0}, measured=False)
    assert "never ahead" in never.lines()[2] and "measured elsewhere" in never.lines()[3]


def test_room_for_the_frames_is_looked_for_before_the_bake(walk: bpy.types.Scene) -> None:
    walk.render.resolution_x = walk.render.resolution_y = 65536
    walk.render.resolution_percentage, walk.frame_end = 100, 100_000
    with pytest.raises(RuntimeError, match=r"100,000 frames need about .* make room"):
        bpy.ops.patchnet.fly_through()
    assert results.result_of(walk) is None


def test_what_moves_is_refused(walk: bpy.types.Scene) -> None:
    slid(walk.objects["Lath 2"], {1: 0.0, 3: 0.1}, axis=2)
    with pytest.raises(RuntimeError, match="change from frame to frame"):
        bpy.ops.patchnet.fly_through()
    assert results.result_of(walk) is None


def test_command(walk: bpy.types.Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = saved(tmp_path / "walk.blend"), tmp_path / "out"
    assert commands.main(["fly-through", str(path), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert films(out) == ["0001.exr", "0002.exr", "0003.exr"] and "3 frames rendered into" in printed.out
    assert "Note: 3 frames " in printed.err
    assert commands.main(["fly-through", str(path), "--out", str(out)]) == 0
    assert "0 frames rendered" in capsys.readouterr().out
    assert commands.main(["fly-through", str(path), "--track", "9-1", "--out", str(tmp_path / "none")]) == 2
