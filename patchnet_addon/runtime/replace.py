# SPDX-License-Identifier: GPL-3.0-or-later
"""Atomic replacement of files of the same kind.

A file is written in a temporary folder beside its destination and renamed once it is complete and on disk, so that a
partial file never replaces a complete one. The next writer of the same file removes leftovers of killed processes.
"""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from .errors import OutputError
from .file_kinds import FileKind
from .owned_folder import owned_folder

_WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


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


@contextlib.contextmanager
def replaced_file(path: Path, kind: FileKind) -> Iterator[BinaryIO]:
    """Open a new file that replaces `path` when the block ends without an error.

    Raises OutputError if it cannot be written or a file of another kind exists there, which then stays unchanged.
    """
    with replaced_path(path, kind) as temporary, temporary.open("xb") as file:
        yield file


@contextlib.contextmanager
def replaced_path(path: Path, kind: FileKind) -> Iterator[Path]:
    """Replace as `replaced_file`, for writers that open files themselves: yields the path to write to."""
    check_replaceable(path, kind)
    try:
        with owned_folder(path) as folder:
            temporary = folder / path.name
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            check_replaceable(path, kind)  # the path may have changed during a long job
            os.replace(temporary, path)
    except OSError as cause:
        name, beside = str(cause.filename), str(path.with_name(f".{path.name}."))
        if cause.filename is not None and name != str(path) and not name.startswith(beside):
            raise  # error of another file
        raise OutputError(
            f"{path} cannot be written: {cause.strerror or cause}; choose another folder or make room"
        ) from cause
