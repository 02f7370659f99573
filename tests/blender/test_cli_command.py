# SPDX-License-Identifier: GPL-3.0-or-later
"""`blender --command patchnet`: sub-commands, exit codes and log, on the open file or a named one.

Blender as a Python module has no command line, so these call what Blender calls; tests/real_blender runs the real one.
"""

import json
import subprocess
import sys
from pathlib import Path

import bpy
import pytest

from patchnet.commands.blender_command import execute
from patchnet.patchnet_addon.runtime import log
from patchnet.tests.blender.job_scene import QUICK
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("text_log")

AT_EXIT = """
import bpy, patchnet
patchnet.register()
patchnet.unregister()
patchnet.register()
assert len(patchnet.commands.blender_command._handles) == 1
print("registered")
"""


def json_lines(text: str) -> list[dict]:
    """Our lines of stderr; Blender's own are no objects."""
    return [json.loads(line) for line in text.splitlines() if line.startswith("{")]


def test_run_of_the_open_file(scene_file: Path, weights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = scene_snapshot()
    assert execute(["run", "--out=//out", "--weights", str(weights), *QUICK]) == 0
    report = json.loads((scene_file.parent / "out" / "report.json").read_text())
    assert report["octree"]["depth"] == 5 and report["light"]["file"] == "small.blend"
    said = capsys.readouterr()
    assert "Results are in" in said.out
    lines = said.err.splitlines()
    assert {"Reading the scene", "Encoding"} <= set(lines) and len(lines) == len(set(lines)), "plain lines: no terminal"
    assert "\r" not in said.err
    assert_unchanged(before)


def test_frames_of_a_named_file(
    scene_file: Path, tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    words = ["run", str(scene_file), "--out", str(tmp_path / "out"), "--weights", str(weights), *QUICK]
    assert execute([*words, "--frames", "1-3x2"]) == 0
    assert execute([*words, "--frames", "1-2", "--log-format", "json"]) == 0
    said = json_lines(capsys.readouterr().err)
    assert said[0]["event"] == "start" and said[0]["command"] == "run" and "--frames" in said[0]["arguments"]
    results = [line for line in said if line["event"] == "result"]
    assert [(line.get("frame"), line["skipped"]) for line in results] == [(1, True), (2, False), (None, [1])]
    assert Path(results[1]["file"]).name == "frame-0002" and Path(results[1]["file"]).is_dir()
    stages = [(line["frame"], line["stage"]) for line in said if line["event"] == "stage" and "frame" in line]
    assert (1, "skipped") in stages and (2, "Encoding") in stages and (2, "Looking at the scene") in stages


def test_export_and_info(scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tree, cloud = tmp_path / "tree.safetensors", tmp_path / "new" / "cloud.ply"
    assert execute(["octree", "--depth", "4", "--light", "two-lights", "--out", str(tree)]) == 0
    assert execute(["export", str(tree), "--level", "3", "--out", str(cloud), "--log-format=json"]) == 0
    (result,) = [line for line in json_lines(capsys.readouterr().err) if line["event"] == "result"]
    assert cloud.read_bytes().startswith(b"ply") and result["file"] == str(cloud) and result["octree_level"] == 3
    assert execute(["info", str(tree)]) == 0
    assert "PatchNet octree" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "/nowhere.blend"], "does not exist"),
        (["run", "--cameras", "Nobody", "--depth", "4"], "'Eye'"),
        (["run", "--depth", "deep"], "'auto'"),
        (["run", "--frames", "3-1"], "before the first"),
        (["info", "/nowhere.safetensors"], "/nowhere.safetensors"),
        (["lab", "train", "."], "invalid choice: 'lab'"),
        (["run", "--nonsense"], "--nonsense"),
        ([], "SUB-COMMAND"),
    ],
)
@pytest.mark.parametrize("log_format", ["text", "json"])
def test_bad_input_is_one_sentence_and_code_2(
    words: list[str], message: str, log_format: str, scene_file: Path, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(scene_file.parent)
    monkeypatch.setenv(log.VARIABLE, log_format)
    assert execute(words) == 2
    said = capfd.readouterr().err
    if log_format == "json":
        error = json_lines(said)[-1]
        assert error["event"] == error["level"] == "error" and error["exit_code"] == 2 and message in error["message"]
        assert not [line for line in said.splitlines() if line.startswith(("patchnet", "usage"))]
    else:
        assert "error: " in said.splitlines()[-1] and message in said.splitlines()[-1] and "Traceback" not in said
    assert [path.name for path in scene_file.parent.iterdir()] == ["small.blend"]


def test_nothing_is_open(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    for words in (["run"], ["octree", "--depth", "4", "--out", str(tmp_path / "a.safetensors")]):
        assert execute(words) == 2
        assert "There is no scene: name its file" in capsys.readouterr().err
    assert execute(["run", "--out", "//out"]) == 2
    assert "relative to the .blend file" in capsys.readouterr().err


@pytest.mark.parametrize("log_format", ["text", "json"])
def test_unexpected_is_code_1_with_a_traceback(
    log_format: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(args: object) -> int:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("patchnet.commands.info.run", fail)
    assert execute(["info", "x", "--log-format", log_format]) == 1
    said = capsys.readouterr().err
    assert "ZeroDivisionError: by nothing" in said and "Traceback" in said
    if log_format == "json":
        error = json_lines(said)[-1]
        assert error["exit_code"] == 1 and "Traceback" in error["traceback"] and len(said.splitlines()) == 2


def test_help_names_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["--help"]) == 0
    said = capsys.readouterr().out
    assert "usage: blender --command patchnet" in said and " lab " not in said
    assert execute(["run", "--help"]) == 0
    assert "--log-format" in capsys.readouterr().out


def test_registered_twice_and_forgotten_at_the_end() -> None:
    done = subprocess.run([sys.executable, "-c", AT_EXIT], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.endswith("registered\n"), done.stdout + done.stderr
