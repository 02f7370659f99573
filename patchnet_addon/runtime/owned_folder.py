# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders of unfinished files, locked by their process, so that those of killed processes can be removed.

Such a folder holds a file `owner`, which its process keeps locked: the system frees the lock when the process ends.
Machines that share a disk do not always see each other's locks, so the file also names the machine. A folder is left
over if its file is not locked, and if either this machine made it or it got no new file for a week.
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import re
import secrets
import shutil
import time
import uuid
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import BinaryIO

if os.name == "nt":
    import msvcrt
else:
    import fcntl

_OWNER, _FILES = "owner", "files"
SILENT_S = 7 * 24 * 3600.0  # after which another machine's process is taken for dead
_BOOT = Path("/proc/sys/kernel/random/boot_id")


@contextlib.contextmanager
def owned_folder(path: Path) -> Iterator[Path]:
    """Make a folder .NAME.0123abcd.tmp beside `path` for the block; yields the folder for files in it.

    Leftovers of killed processes for the same path are removed first.
    """
    remove_left_over(path.parent, re.escape(path.name))
    folder = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    folder.mkdir()
    try:
        with (folder / _OWNER).open("xb") as owner:
            _lock(owner, wait=True)
            owner.write(machine().encode())
            owner.flush()
            files = folder / _FILES
            files.mkdir()
            yield files
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_left_over(folder: Path, names: str) -> None:
    """Remove temporary folders of killed processes in `folder`, for all names that match the pattern `names`."""
    pattern = re.compile(rf"\.{names}\.[0-9a-f]{{8}}\.tmp")
    with contextlib.suppress(OSError):
        for path in list(folder.iterdir()):
            if pattern.fullmatch(path.name) and path.is_dir() and not path.is_symlink() and _is_left_over(path):
                shutil.rmtree(path, ignore_errors=True)


@cache
def machine() -> str:
    """Identity of this machine; containers of one machine are one, as they are for locks."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return f"{platform.node()} {uuid.getnode():x}"


def _is_left_over(folder: Path) -> bool:
    """Return whether no process works in `folder`; raises OSError."""
    with contextlib.suppress(FileNotFoundError), (folder / _OWNER).open("rb+") as owner:
        locked = _lock(owner)
        if locked is False:
            return False
        if locked and owner.read().decode(errors="replace") == machine():
            return True
    return time.time() - max(path.lstat().st_mtime for path in (folder, *folder.rglob("*"))) > SILENT_S


def _lock(file: BinaryIO, *, wait: bool = False) -> bool | None:
    """Return whether `file` is locked now by us: not while another process holds it; None where there are no locks."""
    try:
        if os.name == "nt":
            file.seek(0)
            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        else:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as cause:
        return False if cause.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK) else None
    return True
