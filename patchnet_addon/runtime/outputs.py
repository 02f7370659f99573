# SPDX-License-Identifier: GPL-3.0-or-later
"""Output checks, before a job's first second of work, that all of its files can be written.

Each command and operator says which files it will write, of which kind, and which files it reads. None of those that it
reads is replaced, whatever name or link leads to it, and none that is of another kind than what is written.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from .errors import OutputError
from .file_kinds import FileKind
from .replace import check_replaceable, temporary_path


def check_outputs(
    files: Mapping[Path, FileKind],
    inputs: Iterable[Path] = (),
    *,
    folder: Path | None = None,
    makes_folders: bool = True,
) -> None:
    """Raise OutputError if one of `files` cannot be written, would replace one of `inputs`, or something foreign.

    folder: that of all results, if there is one. makes_folders: whether folders that are not there will be made.
    """
    try:
        if folder is not None and os.path.lexists(folder) and not folder.is_dir():
            raise OutputError(f"{folder} is a file where the output folder should be: choose another folder")
        by_folder: dict[str, list[Path]] = {}
        for path in files:
            by_folder.setdefault(os.path.dirname(path), []).append(path)
        nearest = {name: _nearest_folder(Path(name).absolute(), makes_folders) for name in by_folder}
        for folder in set(nearest.values()):
            check_writable(folder)
        read = identities(inputs)
        for name, paths in by_folder.items():
            _check_lengths(paths, nearest[name])
            for path in paths if os.path.isdir(name or os.curdir) else ():  # else there is nothing yet
                _check_not_read(path, read)
                check_replaceable(path, files[path])
    except OSError as cause:
        raise OutputError(f"{cause.filename} cannot be written ({cause.strerror}): choose another output") from cause


def _check_lengths(paths: Iterable[Path], folder: Path) -> None:
    """Raise OSError if a name is too long for the file system of `folder`, with what makes it a temporary one."""
    longest = max((os.path.basename(path) for path in paths), key=lambda name: len(os.fsencode(name)))
    temporary_path(folder / longest).exists()


def _check_not_read(path: Path, read: Mapping[tuple[int, int], Path]) -> None:
    if (found := identity(path)) is None or found not in read:
        return
    source = read[found]
    same = f"{path} is" if source == path else f"{path} is the same file as {source},"
    raise OutputError(f"{same} what is read here, and would be replaced: choose another output")


def check_writable(folder: Path) -> None:
    """Raise OutputError if no file can be made in `folder`, which is there, or its disk is full."""
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


def _nearest_folder(folder: Path, makes_folders: bool) -> Path:
    """Folder itself, or the nearest one above it that is there; raises OutputError if something is in the way."""
    for parent in (folder, *folder.parents):
        if parent.is_dir():
            return parent
        if os.path.lexists(parent):
            raise OutputError(f"{parent} is a file where a folder should be: choose another output, or move it away")
        if not makes_folders:
            raise OutputError(f"Folder {parent} cannot be written (it does not exist): make it, or choose another one")
    raise OutputError(f"Folder {folder} cannot be made: choose another folder")


def identities(paths: Iterable[Path]) -> dict[tuple[int, int], Path]:
    """Files that are there by what makes them the same file."""
    return {found: path for path in paths if (found := identity(path)) is not None}


def identity(path: Path) -> tuple[int, int] | None:
    """Device and number of a file, the same through all links and spellings; None where there is none."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # ValueError: such as a path of a scene with a zero byte
        return None
    return found.st_dev, found.st_ino
