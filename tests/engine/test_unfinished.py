# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders of killed processes go after a day, others stay."""

import os
import time
from pathlib import Path

import pytest

from patchnet.patchnet_addon.runtime.unfinished import remove_left_over, temporary_folder


@pytest.mark.parametrize(
    ("name", "folder_h", "file_h", "stays"),
    [
        (".out.0123abcd.tmp", 25, 25, False),
        (".out.0123abcd.tmp", 25, 1, True),
        (".out.0123abcd.tmp", 1, 25, True),
        (".xout.0123abcd.tmp", 25, 25, True),
        (".out.notes.tmp", 25, 25, True),
    ],
)
def test_folders_without_new_files_are_left_over(
    name: str, folder_h: float, file_h: float, stays: bool, tmp_path: Path
) -> None:
    folder = tmp_path / name
    folder.mkdir()
    (folder / "half").write_text("half")
    for path, hours in ((folder / "half", file_h), (folder, folder_h)):
        os.utime(path, (time.time() - hours * 3600.0,) * 2)
    (tmp_path / ".out.11111111.tmp").symlink_to(folder)
    remove_left_over(tmp_path, "out")
    assert folder.exists() == stays and (tmp_path / ".out.11111111.tmp").is_symlink()


def test_a_temporary_folder_goes_unless_it_was_moved(tmp_path: Path) -> None:
    with temporary_folder(tmp_path / "a"):
        (tmp_path / "a" / "half").write_text("half")
    with temporary_folder(tmp_path / "b"):
        os.replace(tmp_path / "b", tmp_path / "kept")
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
