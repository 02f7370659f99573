# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished and temporary files and folders, which are removed when the process ends or at a later start."""

from __future__ import annotations

import contextlib
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

_LEFT_OVER_S = 7 * 24 * 3600.0  # without a change, after which a temporary folder is that of a killed process
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
def temporary_folder(folder: Path) -> Iterator[Path]:
    """Make `folder` for the block; it is removed afterwards."""
    folder.mkdir()
    try:
        with unfinished(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_left_over(folder: Path, name: str) -> None:
    """Remove temporary folders for `name` in `folder` (.NAME.0123abcd.tmp) that nothing changed for a week."""
    pattern = re.compile(rf"\.{re.escape(name)}\.[0-9a-f]{{8}}\.tmp")
    with contextlib.suppress(OSError):
        for path in list(folder.iterdir()):
            is_ours = pattern.fullmatch(path.name) and path.is_dir() and not path.is_symlink()
            if is_ours and time.time() - path.stat().st_mtime > _LEFT_OVER_S:
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
