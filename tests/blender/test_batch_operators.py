# SPDX-License-Identifier: GPL-3.0-or-later
"""Every operator in one process without a window, as `blender -b --python-expr` runs it, with its log.

A new operator fails here until it is listed.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.tests.blender.job_scene import build, random_weights, saved

# In an order in which each finds what it needs. WEIGHTS and OUT are filled in.
CALLS = {
    "estimate": "depth=5, light='two-lights', scope='VISIBLE'",
    "voxelize": "depth=5, resolution='DEPTH', scope='VISIBLE'",
    "bake_light": "light='two-lights', exposure=0.5",
    "precompute_codes": "weights=WEIGHTS",
    "render_preview": "size=(16, 16), cameras='Eye', budget=0.5",
    "compare": "size=(16, 16), cameras='Eye', budget=0.5",
    "show_voxels": "level=3",
    "export_octree": "filepath=OUT + '/voxels.safetensors', level=4",
    "load_octree": "filepath=OUT + '/voxels.safetensors', weights=WEIGHTS",
    "clear_results": "",
    "run_all": "depth=4, light='two-lights', size=(16, 16), weights=WEIGHTS, out=OUT + '/all'",
    "bake_animation": "frame_start=2, frame_end=4, frame_step=2, depth=4, light='two-lights', size=(16, 16), "
    "weights=WEIGHTS, out=OUT + '/frames', skip_existing=True",
    "copy_diagnostics": "",
}
# test_preferences.py, on a cache of its own; test_cycles_refine.py, with light that was baked; test_panel.py;
# test_demo_scene.py; test_fly_through.py
ELSEWHERE = {"fly_through", "clear_cache", "refine_with_cycles", "show_picture", "add_demo_scene"}
# Not without a window; tests/real_blender/test_overlay.py tries it.
WINDOW = {"inspect_pixels"}
PREPARE = """
import sys, bpy, patchnet
patchnet.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
WEIGHTS, OUT = sys.argv[2:4]
names = [name for name in dir(bpy.types) if name.startswith("PATCHNET_OT_")]
public = [name for name in names if "INTERNAL" not in getattr(bpy.types, name).bl_options]
ours = sorted(name.removeprefix("PATCHNET_OT_").lower() for name in public)
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch")
    (folder / "out").mkdir()
    build()
    saved(folder / "small.blend")
    random_weights(folder)
    return folder


def batch(code: str, files: Path) -> subprocess.CompletedProcess[str]:
    """Run lines of Python in a Blender without a window whose log is for programs. Its exit may not hang, either."""
    command = [sys.executable, "-c", PREPARE + code, files / "small.blend", files / "random.safetensors", files / "out"]
    environment = {**os.environ, "PATCHNET_LOG": "json", "PYTHONUNBUFFERED": "1"}
    return subprocess.run(
        [*map(str, command)], capture_output=True, text=True, check=False, env=environment, timeout=600
    )


def events(done: subprocess.CompletedProcess[str]) -> list[dict]:
    return [json.loads(line) for line in done.stderr.splitlines() if line.startswith("{")]


@pytest.fixture(scope="module")
def done(files: Path) -> subprocess.CompletedProcess[str]:
    """All operators, one after the other; the animation twice."""
    calls = [f"assert bpy.ops.patchnet.{name}({values}) == {{'FINISHED'}}" for name, values in CALLS.items()]
    again = f"assert bpy.ops.patchnet.bake_animation({CALLS['bake_animation']}) == {{'FINISHED'}}"
    state = "print('HERE', ours, [item.name for item in bpy.data.objects], bpy.context.scene.frame_current)"
    return batch("\n".join([*calls, again, state, "patchnet.unregister()"]), files)


def test_every_operator_finishes(done: subprocess.CompletedProcess[str]) -> None:
    assert done.returncode == 0, done.stdout + done.stderr
    state = next(line for line in done.stdout.splitlines() if line.startswith("HERE"))
    assert str(sorted({*CALLS, *ELSEWHERE, *WINDOW})) in state, "an operator is not called here"
    assert "'PatchNet Voxels'" in state and state.endswith(" 1")


def test_they_leave_what_they_promise(done: subprocess.CompletedProcess[str], files: Path) -> None:
    out = files / "out"
    assert load_octree(out / "voxels.safetensors").depth == 4
    assert load_octree(out / "voxels.safetensors").exposure == 0.5
    assert json.loads((out / "all" / "report.json").read_text())["octree"]["depth"] == 4
    report = json.loads((out / "frames" / "report.json").read_text())
    assert report["complete"] and [entry["frame"] for entry in report["frames"]] == [2, 4]


def test_each_says_so_in_the_log(done: subprocess.CompletedProcess[str], files: Path) -> None:
    said = events(done)
    started = [line["command"] for line in said if line["event"] == "start"]
    assert started == [
        "Estimate", "Voxelize", "Bake Light", "Prepare Look-Ahead", "Render Preview", "Compare Strategies",
        "Show Voxels", "Export Voxels", "Load Octree", "Preview Selection", "Bake Animation", "Bake Animation",
    ]  # fmt: skip
    assert all(line["file"].endswith("small.blend") for line in said if line["event"] == "start")
    results = [line for line in said if line["event"] == "result"]
    assert len(results) == len(started) and not [line for line in said if line["event"] == "error"]
    paths = [Path(line["file"]) for line in results if "file" in line]
    assert paths == [files / "out" / name for name in ("voxels.safetensors", "all", "frames", "frames")]
    assert results[-1]["message"].startswith("0 frames made, 2 were there")
    stages = {line["stage"] for line in said if line["event"] == "stage"}
    assert {"Reading the scene", "Encoding", "Writing files", "skipped"} <= stages
