# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of results that appears complete or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...patchnet_addon.errors import PatchNetError
from ...patchnet_addon.unfinished import unfinished


@contextmanager
def output_folder(out: Path) -> Iterator[Path]:
    """A temporary folder whose files move to `out` when the block ends without an error.

    Files of the same name are replaced, others stay. On an error nothing in `out` is touched.
    Raises PatchNetError, before any work, if `out` cannot be written.
    """
    temporary: Path | None = None
    try:
        temporary = _beside(out)
        with unfinished(temporary):
            yield temporary
        _move(temporary, out)
    except OSError as cause:
        reason = cause.strerror or str(cause)
        raise PatchNetError(f"Folder {out} cannot be written ({reason}): choose another folder or make room") from cause
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def _beside(out: Path) -> Path:
    """New folder in the nearest folder that exists above `out`, so on the same file system."""
    if out.exists() and not out.is_dir():
        raise PatchNetError(f"{out} is a file where the output folder should be: choose another folder")
    parent = out.absolute().parent
    while not parent.exists():
        parent = parent.parent
    temporary = parent / f".{out.name}.{secrets.token_hex(4)}.tmp"
    temporary.mkdir()
    if out.exists() and not os.access(out, os.W_OK):
        temporary.rmdir()
        raise PermissionError(13, "no permission to write")
    return temporary


def _move(source: Path, out: Path) -> None:
    for path in sorted(source.rglob("*")):
        target = out / path.relative_to(source)
        if path.is_dir():
            target.mkdir(parents=True, exist_ok=True)
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(path, target)
