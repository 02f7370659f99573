# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C in the middle of a bake that would take days: the command ends, and leaves nothing but finished pages."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from patchnet.patchnet_addon.kernels import user_cache_folder
from patchnet.tests.blender.job_scene import build, random_weights, saved

pytestmark = pytest.mark.usefixtures("ctrl_c")

# The longest that a stop may take by the project's rule, three times: machines that test do other things too.
PATIENCE_S = 15.0


def environment(cache: Path) -> dict[str, str]:
    """Pages in a folder of their own, kernels as they are compiled already."""
    kernels = user_cache_folder() / "kernels"
    kernels.mkdir(parents=True, exist_ok=True)
    cache.mkdir()
    (cache / "kernels").symlink_to(kernels)
    return {**os.environ, "PATCHNET_CACHE": str(cache), "PYTHONUNBUFFERED": "1"}


def read_until(process: subprocess.Popen[bytes], text: bytes) -> None:
    said = b""
    assert process.stderr is not None
    while text not in said:
        more = process.stderr.read(1)
        assert more, said.decode()
        said += more


@pytest.mark.parametrize("command", ["run", "octree"])
def test_bake_is_interrupted(command: str, tmp_path: Path) -> None:
    build()
    folder = tmp_path / "work"
    folder.mkdir()
    scene = saved(folder / "small.blend")
    arguments = [command, str(scene), "--depth", "6", "--samples", "50000000", "--out", str(folder / "out")]
    if command == "run":
        arguments += ["--size", "16", "16", "--weights", str(random_weights(tmp_path))]
    process = subprocess.Popen(
        [sys.executable, "-m", "patchnet", *arguments], env=environment(tmp_path / "cache"), stderr=subprocess.PIPE
    )
    try:
        read_until(process, b"Baking light")
        time.sleep(1.0)  # now Cycles is at work
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=PATIENCE_S) == 130
        assert process.stderr is not None and b"interrupted" in process.stderr.read()
    finally:
        process.kill()
    assert [path.name for path in folder.iterdir()] == ["small.blend"]
    assert list((tmp_path / "cache").rglob("*.tmp")) == []
