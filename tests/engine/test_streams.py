# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands whose output nobody reads any more: they end as they would, without a traceback."""

import os
import re
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
    ("line", "code"),
    [
        ("patchnet info FILE 2>&-", 0),
        ("patchnet info FILE <&- >&- 2>&-", 0),
        ("patchnet info FILE.none 2>&-", 2),
        ("patchnet info >&- 2>&-", 2),
        ("patchnet --help >&-", 0),
        ("(patchnet info --json FILE; echo $? >&2) | head -c 1 >/dev/null", 0),
        ("(patchnet info FILE.none 2>&1; echo $? >&2) | true", 2),
        ("(patchnet --help; echo $? >&2) | true", 0),
        ("patchnet export FILE --out FILE.ply >&-", 0),
        ("(patchnet export FILE --out FILE.npz 2>&1 >/dev/null; echo $? >&2) | true", 0),
    ],
)
def test_streams_that_nobody_reads(line: str, code: int, file: Path) -> None:
    done = shell(line, file)
    if "|" in line:
        assert done.stderr.splitlines()[-1] == str(code)
    else:
        assert done.returncode == code
    for words in ("Traceback", "Exception ignored", "BrokenPipe", "Bad file descriptor"):
        assert words not in done.stdout + done.stderr
    for ending in re.findall(r"--out FILE(\.\w+)", line):
        assert Path(f"{file}{ending}").stat().st_size > 100


def test_files_do_not_take_the_place_of_a_closed_stream(file: Path) -> None:
    """Prints of compiled code on stdout would go into them."""
    code = "import os; from patchnet.patchnet_addon.runtime.streams import keep_streams; keep_streams(); "
    code += f"import sys; opened = os.open({str(file)!r}, os.O_RDONLY); sys.exit(opened < 3)"
    done = subprocess.run(["sh", "-c", '"$0" -c "$1" <&- >&- 2>&-', sys.executable, code], check=False)
    assert done.returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_is_lost_is_an_error(file: Path) -> None:
    done = shell("patchnet info --json FILE >/dev/full", file)
    assert done.returncode == 2 and "No space left on device" in done.stderr and "Traceback" not in done.stderr
    assert shell("patchnet info nothing 2>/dev/full", file).returncode == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("words", ["--help", "info --help", "--version"])
def test_help_that_is_lost_is_an_error(file: Path, words: str) -> None:
    """Argparse itself passes over it."""
    done = shell(f"patchnet {words} >/dev/full", file)
    assert done.returncode == 2 and "No space left on device" in done.stderr and "Traceback" not in done.stderr
