# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C and SIGTERM during a bake of days: the process ends, finished light stays."""

import importlib
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest

from patchnet import commands
from patchnet.patchnet_addon.runtime.interrupt import prompt_interrupt
from patchnet.tests.blender import light_scene
from patchnet.tests.blender.job_scene import QUICK, build, random_weights, read_until, saved
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("ctrl_c")

# The longest that a stop may take by the project's rule, three times: machines that test do other things too.
PATIENCE_S = 15.0


@pytest.fixture
def variables(cache: Path, temporary: Path) -> dict[str, str]:
    """Environment of a process with caches and temporary files of its own."""
    return {**os.environ, "PATCHNET_CACHE": str(cache), "PYTHONUNBUFFERED": "1", "TMPDIR": str(temporary)}


def start(command: str, folder: Path, variables: dict[str, str]) -> subprocess.Popen[bytes]:
    """A command whose bake would take days, at work in Cycles."""
    (folder / "work").mkdir(exist_ok=True)
    scene = saved(folder / "work" / "small.blend")
    words = [
        command,
        str(scene),
        "--depth",
        "6",
        "--max-samples",
        "65536",
        "--noise-threshold",
        "0.0001",
        "--out",
        str(folder / "work" / "out"),
    ]
    if command == "run":
        words += ["--size", "16", "16", "--weights", str(random_weights(folder))]
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


@pytest.mark.parametrize(("command", "number"), [("run", signal.SIGTERM), ("octree", signal.SIGINT)])
def test_bake_is_interrupted(
    command: str, number: signal.Signals, tmp_path: Path, temporary: Path, variables: dict[str, str]
) -> None:
    build()
    process = start(command, tmp_path, variables)
    try:
        assert list(temporary.glob("blender_*"))
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE_S) == 128 + number
        assert process.stderr is not None
        said = process.stderr.read()
    finally:
        process.kill()
    assert b"interrupted" in said and b"Traceback" not in said
    assert [path.name for path in (tmp_path / "work").iterdir()] == ["small.blend"]
    assert list(tmp_path.glob("cache/**/*.tmp")) == [] and list(temporary.iterdir()) == []


def test_what_a_killed_command_left_goes_with_the_next(
    tmp_path: Path, variables: dict[str, str], weights: Path
) -> None:
    build()
    process = start("run", tmp_path, variables)
    process.kill()
    process.communicate()
    work = tmp_path / "work"
    (left,) = work.glob(".out.*.tmp")
    os.utime(left, (0, 0))
    words = ["run", str(work / "small.blend"), *QUICK, "--weights", str(weights), "--out", str(work / "out")]
    assert commands.main(words) == 0
    assert sorted(path.name for path in work.iterdir()) == ["out", "small.blend"]


def test_ctrl_c_in_what_blender_calls_is_no_error_of_theirs(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Raised in Cycles' own Python, it was printed with a traceback, and lost."""
    build()
    engine = importlib.import_module("cycles.engine")
    bake, calls = engine.bake, []

    def interrupted(*values: object) -> None:
        calls.append("interrupted")
        signal.raise_signal(signal.SIGINT)
        calls.append("went on")
        bake(*values)

    monkeypatch.setattr(engine, "bake", interrupted)
    bpy.context.view_layer.update()
    before = scene_snapshot()
    monkeypatch.setattr("patchnet.patchnet_addon.runtime.interrupt.end_process", lambda *_: None)
    with pytest.raises(KeyboardInterrupt), prompt_interrupt():
        light_scene.bake(depth=4, max_samples=2)
    assert calls == ["interrupted", "went on"]
    said = capfd.readouterr()
    assert "Traceback" not in said.out + said.err
    assert_unchanged(before)


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
