# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C and SIGTERM during a bake of days: the process ends at once, finished light stays."""

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from patchnet import commands
from patchnet.tests.blender.job_scene import QUICK, build, random_weights, read_until, saved

pytestmark = pytest.mark.usefixtures("ctrl_c")

PATIENCE_S = 0.5


@pytest.fixture
def variables(cache: Path, temporary: Path) -> dict[str, str]:
    """Environment of a process with caches and temporary files of its own."""
    return {**os.environ, "PATCHNET_CACHE": str(cache), "PYTHONUNBUFFERED": "1", "TMPDIR": str(temporary)}


def start(folder: Path, variables: dict[str, str]) -> subprocess.Popen[bytes]:
    """A command whose bake would take days, at work in Cycles."""
    (folder / "work").mkdir(exist_ok=True)
    scene = saved(folder / "work" / "small.blend")
    words = ["run", str(scene), "--depth", "6", "--max-samples", "65536", "--noise-threshold", "0.0001"]
    words += ["--size", "16", "16", "--weights", str(random_weights(folder)), "--out", str(folder / "work" / "out")]
    process = subprocess.Popen([sys.executable, "-m", "patchnet", *words], env=variables, stderr=subprocess.PIPE)
    read_until(process, b"Refining light")
    time.sleep(1.0)  # now Cycles is at work
    assert process.poll() is None
    return process


@pytest.fixture
def temporary(tmp_path: Path) -> Path:
    """A folder for temporary files, where Blender has one of its own, too."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_bake_ends_at_once_and_the_next_run_removes_what_it_left(
    number: signal.Signals, tmp_path: Path, variables: dict[str, str], weights: Path
) -> None:
    build()
    process = start(tmp_path, variables)
    try:
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE_S) == -number
    finally:
        process.kill()
        process.communicate()
    work = tmp_path / "work"
    assert len(list(work.glob(".out.*.tmp"))) == 1
    assert list(tmp_path.glob("cache/bakes/*/round-*.safetensors")), "for the next bake"
    words = ["run", str(work / "small.blend"), *QUICK, "--weights", str(weights), "--out", str(work / "out")]
    assert commands.main(words) == 0
    assert sorted(path.name for path in work.iterdir()) == ["out", "small.blend"]


def test_a_run_that_nobody_listens_to_ends(scene_file: Path, weights: Path, temporary: Path) -> None:
    """As programs in pipes do, without a traceback."""
    out = scene_file.parent / "out"
    words = [sys.executable, "-m", "patchnet", "run", str(scene_file), *QUICK, "--weights", str(weights)]
    shell = f"({shlex.join([*words, '--out', str(out)])} 2>&1; echo $? >code) 2>said | true"
    subprocess.run(
        ["sh", "-c", shell], cwd=scene_file.parent, env={**os.environ, "TMPDIR": str(temporary)}, check=False
    )
    said = (scene_file.parent / "said").read_text()
    assert (scene_file.parent / "code").read_text() == "1\n", said
    assert "Traceback" not in said and "Error" not in said
    assert list(temporary.iterdir()) == []
