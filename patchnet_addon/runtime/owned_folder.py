# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders that the process at work in them touches every minute, so that what a dead process left can go.

A folder that no process has touched for an hour, by the disk's own clock, is left over; so machines may share it.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

from .unfinished import unfinished

_FILES = "files"
BEAT_S = 60.0
SILENT_S = 3600.0  # after which a process is taken for dead


@contextlib.contextmanager
def owned_folder(folder: Path) -> Iterator[Path]:
    """Make `folder`, which is this process's within the block and gone after it; gives the place for files in it."""
    folder.mkdir()
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(BEAT_S):
            with contextlib.suppress(OSError):
                os.utime(folder)

    thread = threading.Thread(target=beat, name="PatchNet owner", daemon=True)
    thread.start()
    try:
        with unfinished(folder):
            (folder / _FILES).mkdir()
            yield folder / _FILES
    finally:
        ended.set()
        thread.join()
        shutil.rmtree(folder, ignore_errors=True)


def remove_left_over(folder: Path, name: str) -> None:
    """Remove what dead processes left in `folder` of temporary folders for `name`: .NAME.0123abcd.tmp."""
    pattern = re.compile(rf"\.{re.escape(name)}\.[0-9a-f]{{8}}\.tmp")
    with contextlib.suppress(OSError):
        for path in list(folder.iterdir()):
            if pattern.fullmatch(path.name) and path.is_dir() and not path.is_symlink() and _silent_s(path) > SILENT_S:
                shutil.rmtree(path, ignore_errors=True)


def _silent_s(folder: Path) -> float:
    """Seconds since a folder was touched, by the clock of its disk."""
    now = folder.with_name(f"{folder.name}.now")
    try:
        now.touch()
        return now.stat().st_mtime - folder.stat().st_mtime
    finally:
        now.unlink(missing_ok=True)
