# SPDX-License-Identifier: GPL-3.0-or-later
"""Files and folders that are not finished yet: what has to go if the process ends in the middle of its work."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

_paths: set[Path] = set()


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[None]:
    """`path` is not finished within the block; whoever made it removes it when the block ends otherwise."""
    _paths.add(path)
    try:
        yield
    finally:
        _paths.discard(path)


def remove_unfinished() -> None:
    """Delete what is not finished, before the process ends at once."""
    for path in list(_paths):
        shutil.rmtree(path, ignore_errors=True)
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
