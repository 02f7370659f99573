# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders of dead processes go, those of living ones stay."""

import os
import time
from pathlib import Path

import pytest

from patchnet.patchnet_addon.runtime import owned_folder as module
from patchnet.patchnet_addon.runtime.owned_folder import SILENT_S, owned_folder, remove_left_over


def left(folder: Path, silent_s: float) -> Path:
    (folder / "files").mkdir(parents=True)
    then = time.time() - silent_s
    os.utime(folder, (then, then))
    return folder


def test_what_nobody_touched_for_long_goes_and_what_only_looks_alike_stays(tmp_path: Path) -> None:
    old = 2 * SILENT_S
    mine = left(tmp_path / "mine", old)
    (tmp_path / ".out.00000000.tmp").symlink_to(mine)
    (tmp_path / ".out.11111111.tmp").write_text("a file")
    left(tmp_path / ".out.notes.tmp", old)
    left(tmp_path / ".xout.22222222.tmp", old)
    left(tmp_path / ".out.33333333.tmp", SILENT_S / 2)
    before = sorted(tmp_path.rglob("*"))
    left(tmp_path / ".out.89abcdef.tmp", old)
    remove_left_over(tmp_path, "out")
    assert sorted(tmp_path.rglob("*")) == before


def test_the_folder_is_touched_while_work_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BEAT_S", 0.01)
    with owned_folder(tmp_path / ".out.33333333.tmp") as files:
        os.utime(files.parent, (0, 0))
        deadline = time.monotonic() + 30.0
        while not files.parent.stat().st_mtime and time.monotonic() < deadline:
            time.sleep(0.01)
        remove_left_over(tmp_path, "out")
        assert files.is_dir()
    assert list(tmp_path.iterdir()) == []
