# SPDX-License-Identifier: GPL-3.0-or-later
"""Cache folder of kernels, pages of bakes and finished octrees: the user's, or one that takes its place.

A cache folder may be on a disk that can only be read, as in a container, or may have been made by an administrator.
"""

from __future__ import annotations

import atexit
import logging
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

from .errors import OutputError
from .outputs import check_writable
from .unfinished import goes_with_process

KERNELS, BAKES, OCTREES = "kernels", "bakes", "octrees"
_VERSION = re.compile(r"[0-9a-f]{16}")
_UNUSED_S = 90 * 24 * 3600.0


def user_cache_folder() -> Path:
    """Folder for what can be computed again: `PATCHNET_CACHE`, or the platform's cache folder.

    Where that cannot be written, one for this process among the temporary files takes its place, and the log says so,
    once.
    """
    folder = os.environ.get("PATCHNET_CACHE")
    return _usable(Path(folder) if folder else _platforms())


def kernel_folder(root: Path, version: str) -> Path:
    """Folder in the cache folder `root` for compiled kernels of a version of their sources.

    Versions that nothing has used for a long time, such as those of earlier releases, are deleted when a new one
    begins.
    """
    folder = root / KERNELS / version
    with suppress(OSError):
        if folder.is_dir():
            os.utime(folder)  # used now
            return folder
        for path in folder.parent.iterdir():
            if _VERSION.fullmatch(path.name) and time.time() - path.lstat().st_mtime > _UNUSED_S and path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
    return folder


def folder_bytes(folder: Path) -> int:
    """Bytes of the files that lie in a folder; what another process removes meanwhile counts nothing."""
    total = 0
    with suppress(OSError):
        for path in folder.iterdir():
            with suppress(OSError):
                found = path.stat()
                total += found.st_size if stat.S_ISREG(found.st_mode) else 0
    return total


def _platforms() -> Path:
    home = Path(os.path.expanduser("~"))  # "~" itself for a user without one, as in containers
    if not home.is_absolute():
        home = Path(os.devnull)  # in which no folder can be made
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local") / "patchnet"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "patchnet"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "patchnet"


@cache
def _usable(wanted: Path) -> Path:
    try:
        wanted.mkdir(parents=True, exist_ok=True)
        check_writable(wanted)
        for folder in (wanted / KERNELS, wanted / BAKES, *(wanted / KERNELS).glob("*/")):
            if folder.exists() and not os.access(folder, os.W_OK | os.X_OK):
                raise PermissionError(13, "no permission to write", str(folder))
    except (OSError, OutputError) as cause:
        place = Path(tempfile.mkdtemp(prefix="patchnet-"))  # the user's alone: compiled kernels are executed
        goes_with_process(place)
        atexit.register(shutil.rmtree, place, ignore_errors=True)
        system = cause if isinstance(cause, OSError) else cause.__cause__
        reason = system.strerror if isinstance(system, OSError) else cause
        logging.getLogger("patchnet").warning(
            "The cache folder %s cannot be used (%s), so nothing is kept: kernels are compiled at each start, and a "
            "bake that is stopped begins anew; name a folder that can be written in the preferences or in "
            "PATCHNET_CACHE",
            wanted, reason,
        )  # fmt: skip
        return place
    return wanted
