# SPDX-License-Identifier: GPL-3.0-or-later
"""`--frames` of `patchnet run`; a killed command resumes at the first missing frame."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from patchnet import commands
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.tests.blender.job_scene import QUICK, read_until


def times(out: Path) -> list[int]:
    """When each frame's octree was written, by its frame."""
    return [path.stat().st_mtime_ns for path in sorted(out.glob("frame-*/octree.safetensors"))]


def test_run(scene_file: Path, tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["run", str(scene_file), "--out", str(out), "--weights", str(weights), *QUICK]
    assert commands.main([*words, "--frames", "1,3"]) == 0
    printed = capsys.readouterr().out
    assert (
        "Frame 1: depth 5, " in printed and "samples a pixel" in printed and "2 frames made; results are in" in printed
    )
    assert sorted(path.name for path in out.iterdir()) == ["frame-0001", "frame-0003", "report.json"]
    assert {"octree.safetensors", "codes.safetensors", "report.json", "overview.png", "Eye", "frame.json"} == {
        path.name for path in (out / "frame-0003").iterdir()
    }
    assert str(tmp_path) not in (out / "report.json").read_text() + (out / "frame-0001" / "frame.json").read_text()
    before = times(out)
    assert commands.main([*words, "--frames", "all"]) == 0
    printed = capsys.readouterr().out
    assert "Frame 1 is there: skipped" in printed and "1 frame made, 2 were there" in printed
    assert [times(out)[0], times(out)[2]] == before and len(times(out)) == 3
    assert commands.main([*words, "--frames", "1-3x2"]) == 0
    assert "0 frames made, 2 were there" in capsys.readouterr().out
    assert commands.main([*words, "--frames", "3", "--overwrite"]) == 0
    assert times(out)[2] > before[1] and times(out)[0] == before[0]
    assert commands.main([*words, "--frames", "3", "--reference"]) == 0
    assert ", error " in capsys.readouterr().out, "another frame: it has errors"
    assert commands.main([*words, "--frames", "1-3", "--budget", "0.7"]) == 0
    assert "3 frames made;" in capsys.readouterr().out


def test_same_grid(scene_file: Path, tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["run", str(scene_file), "--out", str(out), "--weights", str(weights), *QUICK, "--frames", "1-3"]
    for said in ("3 frames made;", "0 frames made, 3 were there"):
        assert commands.main([*words, "--same-grid"]) == 0
        assert said in capsys.readouterr().out
    trees = [load_octree(out / f"frame-000{frame}" / "octree.safetensors") for frame in (1, 2, 3)]
    assert len({tree.grid for tree in trees}) == 1 and len({tree.exposure for tree in trees}) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--frames", "3-1"], "before the first"),
        (["--frames", ""], "cannot be read"),
        (["--frames", "one"], "cannot be read"),
        (["--overwrite"], "--overwrite requires --frames"),
        (["--same-grid"], "--same-grid requires --frames"),
    ],
)
def test_bad_frames_end_with_one_sentence(
    words: list[str], said: str, scene_file: Path, tmp_path: Path, weights: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        commands.main(["run", str(scene_file), "--out", str(tmp_path / "out"), "--weights", str(weights), *words]) == 2
    )
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[-1].startswith("patchnet: error: ") and said in lines[-1] and not (tmp_path / "out").exists()


def stopped(command: list[str], how: signal.Signals, at: bytes) -> int:
    """Start a command, send it a signal when it has said `at`; its exit code."""
    process = subprocess.Popen(command, stderr=subprocess.PIPE, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    read_until(process, at)
    time.sleep(0.02)
    process.send_signal(how)
    process.communicate()
    return process.returncode


@pytest.mark.usefixtures("ctrl_c")
def test_interrupted_and_killed_command_goes_on(scene_file: Path, tmp_path: Path, weights: Path) -> None:
    """Stopped once a frame is voxelized, by when its temporary folder is signed."""
    whole, out = tmp_path / "whole", tmp_path / "out"
    words = ["run", str(scene_file), "--weights", str(weights), "--frames", "1-3", *QUICK]
    assert commands.main([*words, "--out", str(whole)]) == 0
    command = [sys.executable, "-m", "patchnet", *words, "--out", str(out)]
    for how, at in (
        (signal.SIGINT, b"Frame 2, 2 of 3: Voxelizing"),
        (signal.SIGKILL, b"Frame 3, 3 of 3: Voxelizing"),
    ):
        assert stopped(command, how, at) == -how
        assert len(times(out)) < 3 and not json.loads((out / "report.json").read_text())["complete"]
    first = times(out)[0]
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "Frame 1 is there: skipped" in again.stdout and "1 frame made, 2 were there" in again.stdout
    assert times(out)[0] == first
    assert sorted(path.name for path in out.iterdir()) == ["frame-0001", "frame-0002", "frame-0003", "report.json"]
    for frame in (1, 2, 3):
        name = f"frame-000{frame}/octree.safetensors"
        assert (out / name).read_bytes() == (whole / name).read_bytes()
