# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished and temporary files and folders, which are removed when the process ends or at a later start."""

from __future__ import annotations

import contextlib
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

_LEFT_OVER_S = 24 * 3600.0  # without a new file: the process was killed
_paths: set[Path] = set()


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[None]:
    """Mark `path` as unfinished within the block; its maker removes it if the block ends with an error."""
    _paths.add(path)
    try:
        yield
    finally:
        _paths.discard(path)


@contextlib.contextmanager
def temporary_folder(folder: Path) -> Iterator[None]:
    """Make `folder` for the block, and remove it afterwards unless it was moved."""
    folder.mkdir()
    try:
        with unfinished(folder):
            yield
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_left_over(folder: Path, name: str) -> None:
    """Remove temporary folders of killed processes for `name` in `folder`, .NAME.0123abcd.tmp, after a day."""
    pattern = re.compile(rf"\.{re.escape(name)}\.[0-9a-f]{{8}}\.tmp")
    with contextlib.suppress(OSError):
        for path in list(folder.iterdir()):
            if pattern.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
                newest = max(found.lstat().st_mtime for found in (path, *path.rglob("*")))
                if time.time() - newest > _LEFT_OVER_S:
                    shutil.rmtree(path, ignore_errors=True)


def goes_with_process(path: Path) -> None:
    """Mark `path` as temporary for this process."""
    _paths.add(path)


def remove_unfinished() -> None:
    """Delete all marked files and folders, before the process ends."""
    for path in list(_paths):
        shutil.rmtree(path, ignore_errors=True)
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
