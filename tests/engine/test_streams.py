# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands whose output nobody reads any more end without a traceback; output that is lost is an error."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.tests.engine.octree_samples import random_octree

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no such shell")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streams") / "octree.safetensors"
    save_octree(random_octree(seed=5, depth=5, count=100), path)
    return path


def shell(line: str, file: Path) -> subprocess.CompletedProcess[str]:
    """Run a line of a shell in which `patchnet` is the command; its own exit code is printed on the line's stderr."""
    command = f'"{sys.executable}" -m patchnet'
    return subprocess.run(
        ["sh", "-c", line.replace("patchnet", command).replace("FILE", str(file))],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    "line",
    [
        "patchnet info --json FILE | head -c 1 >/dev/null",
        "patchnet info --json FILE | true",
        "patchnet info FILE.none 2>&1 | true",
        "patchnet --help | true",
        "patchnet export FILE --out FILE.ply 2>&1 | true",
    ],
)
def test_broken_pipes(line: str, file: Path) -> None:
    done = shell(line, file)
    assert done.stdout + done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_is_lost_is_an_error(file: Path) -> None:
    for words in ("info FILE", "info --json FILE", "--version"):
        done = shell(f"patchnet {words} >/dev/full", file)
        assert done.returncode == 1 and "No space left on device" in done.stderr
    assert shell("patchnet info nothing 2>/dev/full", file).returncode == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_an_error_that_cannot_be_said_ends_as_any_other() -> None:
    """Through `leave`, without which a process with Blender in it might not end."""
    lines = ["from patchnet import __main__ as entry", "def fail(): raise ZeroDivisionError", "entry._run = fail"]
    lines += ["leave = entry.leave", "entry.leave = lambda code: (print('left', flush=True), leave(code))"]
    words = [sys.executable, "-c", "\n".join([*lines, "entry.main()"])]
    with open("/dev/full", "wb") as full:
        done = subprocess.run(words, stdout=subprocess.PIPE, stderr=full, check=False)
    assert (done.returncode, done.stdout) == (1, b"left\n")


def test_files_do_not_get_what_is_printed_to_closed_streams(tmp_path: Path) -> None:
    own = tmp_path / "own"
    lines = ["import os", "from patchnet import __main__ as entry", "def run():", f" file = open({str(own)!r}, 'wb')"]
    lines += [" os.write(1, b'printed')", " file.write(b'own')", " file.close()", " return 0", "entry._run = run"]
    words = ["sh", "-c", f'exec "{sys.executable}" -c "$0" <&- >&-', "\n".join([*lines, "entry.main()"])]
    done = subprocess.run(words, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert own.read_bytes() == b"own"
