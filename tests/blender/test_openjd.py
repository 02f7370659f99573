# SPDX-License-Identifier: GPL-3.0-or-later
"""The Open Job Description template is valid and makes the frames of a scene."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.tests.blender.job_scene import moving_slab

pytest.importorskip("openjd.cli", reason="openjd-cli is not installed")
ROOT = Path(__file__).resolve().parents[2]
TEMPLATE = ROOT / "docs" / "openjd" / "patchnet.yaml"
OPENJD = [sys.executable, "-m", "openjd"]
# A program that has Blender's command `patchnet`, which Blender as a Python module lacks.
SHIM = f"""#!/bin/sh
test "$1 $2" = "--command patchnet" || exit 99
shift 2
exec {sys.executable} -c 'import os, sys, bpy; from patchnet.commands.blender_command import execute
code = execute(sys.argv[1:]); sys.stdout.flush(); os._exit(code)' "$@"
"""


@pytest.fixture
def job(tmp_path: Path) -> list[str]:
    """Words of `openjd run` for the small scene at frames 1 to 3; the slab moves."""
    program = tmp_path / "blender"
    program.write_text(SHIM)
    program.chmod(0o755)
    values = {
        "SceneFile": moving_slab(tmp_path), "OutputFolder": tmp_path / "out", "Frames": "1-3:2", "Depth": "5",
        "Light": "two-lights", "Width": "16", "Height": "16", "BlenderCommand": program,
    }  # fmt: skip
    return ["run", str(TEMPLATE), *[word for name, value in values.items() for word in ("-p", f"{name}={value}")]]


def openjd(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*OPENJD, *words], capture_output=True, text=True, check=False, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )


def test_template_is_valid() -> None:
    done = openjd("check", str(TEMPLATE))
    assert done.returncode == 0 and "passes validation" in done.stdout, done.stdout + done.stderr


def test_job_makes_the_frames(job: list[str], tmp_path: Path) -> None:
    done = openjd(*job, "--step", "Report", "--run-dependencies")
    assert done.returncode == 0, done.stdout + done.stderr
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == ["frame-0001", "frame-0003", "report.json"]
    report = json.loads((out / "report.json").read_text())
    assert report["complete"] and report["reference"] == 1
    assert [entry["frame"] for entry in report["frames"]] == [1, 3]
    assert len({entry["exposure"] for entry in report["frames"]}) == 1
    assert done.stdout.count('"skipped": true') == 3, "frame 1 in the step Frames, both in the step Report"
