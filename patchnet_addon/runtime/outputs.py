# SPDX-License-Identifier: GPL-3.0-or-later
"""Output checks before a job starts: all of its files can be written.

Each command and operator names the files that it will write, with their kinds, and the files that it reads. No input is
replaced, whatever path or link leads to it, and no file of another kind.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from .errors import OutputError
from .file_kinds import FileKind
from .quantities import bytes_text
from .replace import check_replaceable


def check_outputs(
    files: Mapping[Path, FileKind],
    inputs: Iterable[Path] = (),
    *,
    folder: Path | None = None,
    makes_folders: bool = True,
) -> None:
    """Raise OutputError if one of `files` cannot be written, or would replace one of `inputs` or a file of another
    kind.

    folder: output folder of the job, if it has one. makes_folders: the job creates missing folders.
    """
    try:
        if folder is not None and os.path.lexists(folder) and not folder.is_dir():
            raise OutputError(f"{folder} is a file, and the output needs a folder: choose another folder")
        by_folder: dict[str, list[Path]] = {}
        for path in files:
            by_folder.setdefault(os.path.dirname(path), []).append(path)
        for folder in {_nearest_folder(Path(name).absolute(), makes_folders) for name in by_folder}:
            check_writable(folder)
        read = identities(inputs)
        for name, paths in by_folder.items():
            for path in paths if os.path.isdir(name or os.curdir) else ():  # otherwise the folder is empty
                _check_not_read(path, read)
                check_replaceable(path, files[path])
    except OSError as cause:
        raise OutputError(f"{cause.filename} cannot be written ({cause.strerror}): choose another output") from cause


def _check_not_read(path: Path, read: Mapping[tuple[int, int], Path]) -> None:
    if (found := identity(path)) is None or found not in read:
        return
    source = read[found]
    same = f"{path} is an input" if source == path else f"{path} is the same file as the input {source}"
    raise OutputError(f"{same} and would be replaced: choose another output")


def check_writable(folder: Path) -> None:
    """Raise OutputError if no file can be created in the existing `folder`, or its disk is full."""
    try:
        descriptor, name = tempfile.mkstemp(prefix=".patchnet-", suffix=".tmp", dir=folder)
        try:
            os.write(descriptor, bytes(4096))
        finally:
            os.close(descriptor)
            os.unlink(name)
    except OSError as cause:
        reason = cause.strerror or str(cause)
        raise OutputError(
            f"Folder {folder} cannot be written ({reason}): choose another folder or make room"
        ) from cause


def check_room(folder: Path, wanted_bytes: float, what: str) -> None:
    """Raise OutputError if the disk of a folder, which need not exist yet, has no room for `what`, in words."""
    free = shutil.disk_usage(_nearest_folder(folder.absolute(), True)).free
    if free < wanted_bytes:
        raise OutputError(
            f"{what} need about {bytes_text(wanted_bytes)}, and {folder} has {bytes_text(free)}: make room, or choose "
            "another folder"
        )


def _nearest_folder(folder: Path, makes_folders: bool) -> Path:
    """Nearest existing parent of a folder, or itself; raises OutputError if a file has the name of a parent."""
    for parent in (folder, *folder.parents):
        if parent.is_dir():
            return parent
        if os.path.lexists(parent):
            raise OutputError(f"{parent} is a file, and a folder is needed: choose another output, or move the file")
        if not makes_folders:
            raise OutputError(f"Folder {parent} does not exist: create it, or choose another folder")
    raise OutputError(f"Folder {folder} cannot be created: choose another folder")


def identities(paths: Iterable[Path]) -> dict[tuple[int, int], Path]:
    """Existing files by device and inode."""
    return {found: path for path in paths if (found := identity(path)) is not None}


def identity(path: Path) -> tuple[int, int] | None:
    """Device and inode of a file, the same for all links and spellings; None if it does not exist."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # ValueError: a path with a zero byte
        return None
    return found.st_dev, found.st_ino
