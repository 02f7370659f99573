# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders of dead processes go, those of living ones stay, on this machine and on others."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from patchnet.patchnet_addon.runtime.owned_folder import SILENT_S, machine, owned_folder, remove_left_over

WORK = """
import sys, time
from pathlib import Path
from patchnet.patchnet_addon.runtime.owned_folder import owned_folder
with owned_folder(Path(sys.argv[1])) as files:
    (files / "half").write_text("half")
    print(files.parent, flush=True)
    time.sleep(600)
"""


@pytest.fixture
def worker(tmp_path: Path):
    """A process at work in `.out.0123abcd.tmp`."""
    process = subprocess.Popen([sys.executable, "-c", WORK, str(tmp_path / "out")], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        folder = Path(process.stdout.readline().strip())
        assert folder.parent == tmp_path and re.fullmatch(r"\.out\.[0-9a-f]{8}\.tmp", folder.name)
        yield process, folder
    finally:
        process.kill()
        process.communicate()


def test_a_living_process_keeps_its_folder_and_a_dead_one_does_not(worker, tmp_path: Path) -> None:
    process, folder = worker
    remove_left_over(tmp_path, "out")
    assert (folder / "files" / "half").read_text() == "half"
    (folder / "owner").write_text("some other machine")  # whose lock is seen here
    os.utime(folder / "owner", (0, 0))
    remove_left_over(tmp_path, "out")
    assert folder.is_dir()
    (folder / "owner").write_text(machine())
    process.kill()
    process.wait()
    remove_left_over(tmp_path, "other")
    assert folder.is_dir(), "another output's"
    with owned_folder(tmp_path / "out") as files:
        assert list(tmp_path.iterdir()) == [files.parent]
    assert list(tmp_path.iterdir()) == []


def left(folder: Path, owner: str | None, silent_s: float) -> Path:
    """A folder that nobody has locked."""
    (folder / "files").mkdir(parents=True)
    if owner is not None:
        (folder / "owner").write_text(owner)
    for path in (*folder.iterdir(), folder):
        os.utime(path, (time.time() - silent_s,) * 2)
    return folder


@pytest.mark.parametrize(
    ("owner", "silent_s", "stays"),
    [
        (machine(), 0.0, False),
        ("another machine, whose locks are not seen here", SILENT_S / 2, True),
        ("another machine, whose locks are not seen here", SILENT_S * 2, False),
        (None, SILENT_S / 2, True),
        (None, SILENT_S * 2, False),
    ],
)
def test_who_cannot_be_asked_is_dead_when_silent(
    owner: str | None, silent_s: float, stays: bool, tmp_path: Path
) -> None:
    folder = left(tmp_path / ".out.89abcdef.tmp", owner, silent_s)
    remove_left_over(tmp_path, "out")
    assert folder.exists() == stays and len(list(tmp_path.iterdir())) == stays


def test_what_only_looks_alike_stays(tmp_path: Path) -> None:
    mine = left(tmp_path / "mine", machine(), 0.0)
    (tmp_path / ".out.00000000.tmp").symlink_to(mine)
    (tmp_path / ".out.11111111.tmp").write_text("a file")
    left(tmp_path / ".out.notes.tmp", machine(), 0.0)
    left(tmp_path / ".xout.22222222.tmp", machine(), 0.0)
    before = sorted(tmp_path.rglob("*"))
    remove_left_over(tmp_path, "out")
    assert sorted(tmp_path.rglob("*")) == before
