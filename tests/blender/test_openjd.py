# SPDX-License-Identifier: GPL-3.0-or-later
"""The Open Job Description template is valid and makes the frames of a scene."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.tests.blender.job_scene import check_walk, moving_slab, stand_in_for_blender

pytest.importorskip("openjd.cli", reason="openjd-cli is not installed")
ROOT = Path(__file__).resolve().parents[2]
TEMPLATE = ROOT / "docs" / "openjd" / "patchnet.yaml"
OPENJD = [sys.executable, "-m", "openjd"]


@pytest.fixture
def job(tmp_path: Path) -> list[str]:
    """Words of `openjd run` for the small scene at frames 1 to 3; the slab moves."""
    values = {
        "SceneFile": moving_slab(tmp_path), "OutputFolder": tmp_path / "out", "Frames": "1-3:2", "Depth": "5",
        "Light": "two-lights", "Width": "16", "Height": "16", "BlenderCommand": stand_in_for_blender(tmp_path),
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
    check_walk(out, reference=1)
    assert done.stdout.count('"skipped": true') == 3, "frame 1 in the step Frames, both in the step Report"
