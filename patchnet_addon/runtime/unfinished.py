# SPDX-License-Identifier: GPL-3.0-or-later
"""Unfinished files and folders, or such only for this process: they have to go when it ends at once."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

_paths: set[Path] = set()


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[None]:
    """Mark `path` as not finished within the block; its maker removes it when the block ends otherwise."""
    _paths.add(path)
    try:
        yield
    finally:
        _paths.discard(path)


def goes_with_process(path: Path) -> None:
    """Mark `path` as of no use any more when this process ends."""
    _paths.add(path)


def remove_unfinished() -> None:
    """Delete what is not finished or of no use any more, before the process ends at once."""
    for path in list(_paths):
        shutil.rmtree(path, ignore_errors=True)
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
