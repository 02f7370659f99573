# SPDX-License-Identifier: GPL-3.0-or-later
"""Atomic replacement of files of the same kind.

A file is written beside its destination and renamed once it is complete and on disk, so that a partial file never
replaces a complete one. Unfinished and temporary files and folders are removed when the process ends, or at a later
start.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from .errors import OutputError
from .file_kinds import FileKind

_WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH

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


def check_replaceable(path: Path, kind: FileKind) -> None:
    """Raise OutputError if a file of `kind` must not replace `path`."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return
    except OSError as cause:
        raise OutputError(f"{path} cannot be written: {cause.strerror or cause}; choose another output") from cause
    if stat.S_ISDIR(found.st_mode):
        raise OutputError(f"{path} is a folder, and {kind.title} cannot replace it: choose another output")
    if not stat.S_ISREG(found.st_mode):
        raise OutputError(f"{path} is not a regular file: choose another output")
    try:
        same = kind.is_at(path)
    except OSError as cause:
        reason = cause.strerror or cause
        raise OutputError(f"{path} exists, but cannot be read ({reason}): choose another output") from cause
    if not same:
        raise OutputError(f"{path} is not {kind.title}, so it is not replaced: choose another output, or move it away")
    if not found.st_mode & _WRITABLE:
        raise OutputError(f"{path} is write-protected: choose another output, or lift the protection")


def temporary_path(path: Path) -> Path:
    """New name beside `path` for an unfinished file, .NAME.0123abcd.tmp, which clean-up recognizes."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")


@contextlib.contextmanager
def replaced_file(path: Path, kind: FileKind) -> Iterator[BinaryIO]:
    """Open a new file beside `path` that replaces it when the block ends without an error.

    Raises OutputError if it cannot be written or a file of another kind exists there, which then stays unchanged.
    """
    with replaced_path(path, kind) as temporary, temporary.open("xb") as file:
        yield file


@contextlib.contextmanager
def replaced_path(path: Path, kind: FileKind) -> Iterator[Path]:
    """Replace as `replaced_file`, for writers that open files themselves: yields the path to write to."""
    check_replaceable(path, kind)
    temporary = temporary_path(path)
    try:
        with unfinished(temporary):
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            check_replaceable(path, kind)  # the path may have changed during a long job
            os.replace(temporary, path)
    except OSError as cause:
        if cause.filename is not None and cause.filename not in (str(path), str(temporary)):
            raise  # error of another file
        raise OutputError(
            f"{path} cannot be written: {cause.strerror or cause}; choose another folder or make room"
        ) from cause
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
