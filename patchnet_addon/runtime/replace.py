# SPDX-License-Identifier: GPL-3.0-or-later
"""Atomic replacement of files: they appear complete or not at all, and never in place of something else.

A file is written beside its destination and renamed when it is complete and on disk, so a half-written file never
replaces a good one.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from .errors import OutputError
from .file_kinds import FileKind
from .unfinished import unfinished

_WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


def check_replaceable(path: Path, kind: FileKind) -> None:
    """Raise OutputError if something is at `path` that a file of `kind` must not take the place of."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return
    except OSError as cause:
        raise OutputError(f"{path} cannot be written: {cause.strerror or cause}; choose another output") from cause
    if stat.S_ISDIR(found.st_mode):
        raise OutputError(f"{path} is a folder where {kind.title} is to be written: choose another output")
    if not stat.S_ISREG(found.st_mode):
        raise OutputError(f"{path} is no file that can be replaced: choose another output")
    try:
        same = kind.is_at(path)
    except OSError as cause:
        raise OutputError(
            f"{path} is there and cannot be looked at ({cause.strerror or cause}), so it stays: choose another output"
        ) from cause
    if not same:
        raise OutputError(f"{path} is not {kind.title}, so it is not replaced: choose another output, or move it away")
    if not found.st_mode & _WRITABLE or _is_someone_elses(path, found):
        raise OutputError(f"{path} is write-protected: choose another output, or lift the protection")


def _is_someone_elses(path: Path, found: os.stat_result) -> bool:
    """Return whether a sticky folder, such as /tmp, keeps us from replacing the file."""
    if not hasattr(os, "geteuid") or os.geteuid() == 0:
        return False
    folder = path.parent.stat()
    return bool(folder.st_mode & stat.S_ISVTX) and os.geteuid() not in (folder.st_uid, found.st_uid)


def temporary_path(path: Path) -> Path:
    """New name beside `path` for what is not finished yet, in the form that is looked for to tidy up."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")


@contextlib.contextmanager
def replaced_file(path: Path, kind: FileKind) -> Iterator[BinaryIO]:
    """File beside `path` that takes its place, once it is on disk, when the block ends without an error.

    Raises OutputError if it cannot be written, or if a file of another kind is there, before the block begins; what
    stood at `path` is then unchanged.
    """
    with replaced_path(path, kind) as temporary, temporary.open("xb") as file:
        yield file


@contextlib.contextmanager
def replaced_path(path: Path, kind: FileKind) -> Iterator[Path]:
    """Replace as `replaced_file`, for writers that open the file on their own: yields the path they are to write."""
    check_replaceable(path, kind)
    temporary = temporary_path(path)
    try:
        with unfinished(temporary):
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            check_replaceable(path, kind)  # long jobs leave time to put something there
            os.replace(temporary, path)
    except OSError as cause:
        if cause.filename is not None and cause.filename not in (str(path), str(temporary)):
            raise  # it speaks of another file
        raise OutputError(
            f"{path} cannot be written: {cause.strerror or cause}; choose another folder or make room"
        ) from cause
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
