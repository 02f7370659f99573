# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary folders locked by their process, so that those of killed processes can be removed.

Such a folder holds a file `owner`, which its process keeps locked: the system frees the lock when the process ends.
Machines that share a disk do not always see each other's locks, so the file also names the machine, and its process
touches it every minute. A folder is left over if its file is not locked, and if either this machine made it or no
process has touched it for an hour, by the disk's own clock.
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import re
import shutil
import threading
import uuid
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import BinaryIO

from .unfinished import unfinished

if os.name == "nt":
    import msvcrt
else:
    import fcntl

_OWNER, _FILES = "owner", "files"
BEAT_S = 60.0
SILENT_S = 3600.0  # after which another machine's process is taken for dead
_UNSIGNED_S = 24 * 3600.0  # the same of a folder without an owner, as older versions left them
_BOOT = Path("/proc/sys/kernel/random/boot_id")


@contextlib.contextmanager
def owned_folder(folder: Path) -> Iterator[Path]:
    """Make `folder` for the block, and remove it afterwards; yields the folder for files in it."""
    folder.mkdir()
    try:
        with unfinished(folder), (folder / _OWNER).open("xb") as owner, _beating(folder / _OWNER):
            _lock(owner, wait=True)
            owner.write(machine().encode())
            owner.flush()
            files = folder / _FILES
            files.mkdir()
            yield files
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_left_over(folder: Path, name: str) -> None:
    """Remove temporary folders of killed processes for `name` in `folder`: .NAME.0123abcd.tmp."""
    pattern = re.compile(rf"\.{re.escape(name)}\.[0-9a-f]{{8}}\.tmp")
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
    try:
        with (folder / _OWNER).open("rb+") as owner:
            locked = _lock(owner)
            if locked is False:
                return False
            mine = owner.read().decode(errors="replace") == machine()
    except FileNotFoundError:
        return _silent_s(folder, folder) > _UNSIGNED_S
    return bool(locked and mine) or _silent_s(folder / _OWNER, folder) > SILENT_S


def _silent_s(path: Path, folder: Path) -> float:
    """Seconds since `path` was touched, by the clock of the disk that `folder` is on."""
    touched = path.stat().st_mtime
    now = folder.with_name(f"{folder.name}.now")
    try:
        now.touch()
        return now.stat().st_mtime - touched
    finally:
        now.unlink(missing_ok=True)


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


@contextlib.contextmanager
def _beating(owner: Path) -> Iterator[None]:
    """Touch the file `owner` at intervals within the block, in a thread."""
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(BEAT_S):
            with contextlib.suppress(OSError):
                os.utime(owner)

    thread = threading.Thread(target=beat, name="PatchNet owner", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
