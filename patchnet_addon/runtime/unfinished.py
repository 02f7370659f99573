# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished and temporary files and folders, which are removed when the process ends or at a later start."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

_paths: set[Path] = set()


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[None]:
    """Mark `path` as unfinished within the block; its maker removes it if the block ends with an error."""
    _paths.add(path)
    try:
        yield
    finally:
        _paths.discard(path)


def goes_with_process(path: Path) -> None:
    """Mark `path` as temporary for this process."""
    _paths.add(path)


def remove_unfinished() -> None:
    """Delete all marked files and folders, before the process ends."""
    for path in list(_paths):
        shutil.rmtree(path, ignore_errors=True)
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
