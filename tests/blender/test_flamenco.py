# SPDX-License-Identifier: GPL-3.0-or-later
"""The Flamenco job type, compiled by Node as in a Manager; its commands make the frames."""

import json
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from patchnet.patchnet_addon.runtime.frames import parse_frames
from patchnet.tests.blender.job_scene import check_walk, moving_slab, stand_in_for_blender

NODE = shutil.which("node") or shutil.which("nodejs")
pytestmark = pytest.mark.skipif(NODE is None, reason="there is no Node here: apt-get install nodejs")
ROOT = Path(__file__).resolve().parents[2]
JOB_TYPE = ROOT / "docs" / "flamenco" / "patchnet.js"
MANAGER = Path(__file__).with_name("flamenco_manager.js")


def manager(settings: dict[str, Any] | None = None) -> subprocess.CompletedProcess[str]:
    """What Node says of the job type, and of a job with these settings."""
    return subprocess.run(
        [str(NODE), str(MANAGER), str(JOB_TYPE)],
        input=json.dumps({"settings": settings}), capture_output=True, text=True, check=False,
    )  # fmt: skip


def declared() -> list[dict[str, Any]]:
    """Settings of the job type."""
    done = manager()
    assert done.returncode == 0, done.stderr
    settings: list[dict[str, Any]] = json.loads(done.stdout)["job_type"]["settings"]
    return settings


def filled(**given: Any) -> dict[str, Any]:
    """Settings of a job as Blender's add-on sends them: what is evaluated there, defaults, and those that are given."""
    values = {row["key"]: row["default"] for row in declared() if "default" in row}
    values["blendfile"] = "/scene.blend"
    for row in declared():
        if "eval" in row and row["key"] not in given:
            names = {
                "C": bpy.context, "Path": Path, "abspath": bpy.path.abspath, "jobname": "walk",
                "settings": SimpleNamespace(**values),
            }  # fmt: skip
            values[row["key"]] = eval(row["eval"], names)
    return {**values, **given}


def tasks_of(settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Tasks of a job, in the order in which they were added."""
    done = manager(settings)
    assert done.returncode == 0, done.stderr
    tasks: list[dict[str, Any]] = json.loads(done.stdout)["tasks"]
    return tasks


def run_tasks(tasks: list[dict[str, Any]], blender: Path) -> list[str]:
    """Run tasks after those that they depend on, as workers do; names of those that ended well."""
    done: list[str] = []
    waiting = list(tasks)
    while ready := [task for task in waiting if set(task["dependencies"]) <= set(done)]:
        for task in ready:
            waiting.remove(task)
            for command in task["commands"]:
                assert command["name"] == "exec"
                words = [command["parameters"]["exe"], *command["parameters"]["args"]]
                words = [word.replace("{blender}", str(blender)) for word in words]
                if subprocess.run(words, capture_output=True, check=False).returncode:
                    return done
            done.append(task["name"])
    assert not waiting
    return done


@pytest.fixture
def blender(tmp_path: Path) -> Path:
    """Stand-in for the program Blender."""
    return stand_in_for_blender(tmp_path)


@pytest.fixture
def small(tmp_path: Path) -> dict[str, Any]:
    """Settings for the small scene, whose slab moves."""
    return {
        "blendfile": str(moving_slab(tmp_path)), "output_root": str(tmp_path / "out"), "frames": "1, 3", "depth": "5",
        "light": "two-lights", "width": 16, "height": 16, "exposure_frame": 3, "chunk_size": 2,
    }  # fmt: skip


def test_settings_are_those_that_flamenco_knows() -> None:
    known = {"key", "type", "subtype", "choices", "propargs", "description", "label", "default", "eval", "evalInfo",
             "visible", "required", "editable"}  # fmt: skip
    rows = declared()
    assert len({row["key"] for row in rows}) == len(rows)
    for row in rows:
        assert set(row) <= known and row["type"] in ("string", "int32", "float", "bool") and row["description"]
        assert row.get("visible", "visible") in ("visible", "hidden", "submission", "web")
        assert "default" not in row or isinstance(row["default"], int if row["type"] == "int32" else str)
        assert "choices" not in row or row["default"] in row["choices"]


def test_settings_are_evaluated_in_blender(tmp_path: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 3, 7
    bpy.context.scene.frame_set(5)
    settings = filled()
    assert (settings["frames"], settings["exposure_frame"]) == ("3-7", 5)
    assert Path(settings["output_folder"]) == tmp_path / "out" / "walk"


def test_tasks_wait_for_each_other() -> None:
    tasks = tasks_of(filled(frames="1-4, 9,7..8", chunk_size=3, output_folder="/out"))
    assert [task["name"] for task in tasks] == ["exposure", "frames-1-3", "frames-4,7,8", "frames-9", "report"]
    assert [task["dependencies"] for task in tasks[:-1]] == [[], *[["exposure"]] * 3]
    assert tasks[-1]["dependencies"] == [task["name"] for task in tasks[1:-1]]
    words = [task["commands"][0]["parameters"]["args"] for task in tasks]
    frames = [parse_frames(each[each.index("--frames") + 1]) for each in words]
    assert frames[1:] == [(1, 2, 3), (4, 7, 8), (9,), (1, 2, 3, 4, 7, 8, 9)]
    rest = {tuple(word for word in each if word != each[each.index("--frames") + 1]) for each in words}
    assert len(rest) == 1, "else frames would not count as made"


def test_job_without_a_folder_is_refused() -> None:
    done = manager(filled(output_folder=""))
    assert done.returncode != 0 and "choose one as Output Root" in done.stderr


def test_job_makes_the_frames(small: dict[str, Any], blender: Path, tmp_path: Path) -> None:
    done = run_tasks(tasks_of(filled(**small)), blender)
    assert done == ["exposure", "frames-1,3", "report"]
    out = tmp_path / "out" / "walk"
    check_walk(out, reference=3)
