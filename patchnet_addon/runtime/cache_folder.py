# SPDX-License-Identifier: GPL-3.0-or-later
"""Cache folder of kernels, baked light, octrees and unpacked wheels: the user's cache folder or a fallback.

A cache folder may be read-only, as in a container, or belong to an administrator. Compiled kernels are code that is
executed, so the fallback is the user's own, and lasts as long as the process.
"""

from __future__ import annotations

import atexit
import logging
import os
import re
import shutil
import sys
import tempfile
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

from .errors import OutputError
from .outputs import check_writable
from .owned_folder import owned_folder

KERNELS, BAKES, OCTREES, WHEELS = "kernels", "bakes", "octrees", "wheels"
_LOG = logging.getLogger("patchnet")
_VERSION = re.compile(r"[0-9a-f]{16}")
_UNUSED_S = 90 * 24 * 3600.0


def user_cache_folder() -> Path:
    """Cache folder: `PATCHNET_CACHE`, or the platform's cache folder.

    If it is not writable, a temporary folder is the fallback, with one warning in the log.
    """
    return _usable(_wanted())


def kernel_folder(root: Path, version: str) -> Path:
    """Folder in the cache folder `root` for compiled kernels of a version of their sources.

    If `root` is a fallback or the extension's own folder, kernels are copied from PATCHNET_CACHE and from the
    platform's cache folder. A new version deletes versions that were not used for 90 days.
    """
    folder = root / KERNELS / version
    for other in {_wanted(), _platforms()} - {root}:
        source = other / KERNELS / version
        if not source.is_dir() or folder.exists():
            continue
        # Another process may be faster, or the disk full: kernels are compiled again.
        with suppress(OSError):
            folder.parent.mkdir(parents=True, exist_ok=True)
            with owned_folder(folder) as copy:
                for path in source.rglob("*.nb[ic]"):
                    target = copy / path.relative_to(source)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(path, target)  # without its mode, which may be read-only
                os.replace(copy, folder)
    if folder.is_dir():
        with suppress(OSError):
            os.utime(folder)  # marks its last use
    else:
        remove_unused(root / KERNELS)
    return folder


def remove_unused(folder: Path) -> None:
    """Delete folders of versions, named by 16 hexadecimal digits, that were not used for 90 days."""
    with suppress(OSError):
        for path in folder.iterdir():
            if _VERSION.fullmatch(path.name) and time.time() - path.lstat().st_mtime > _UNUSED_S and path.is_dir():
                shutil.rmtree(path, ignore_errors=True)


def folder_bytes(folder: Path) -> int:
    """Total size of the files directly in a folder, in bytes; 0 if one of them disappears meanwhile."""
    with suppress(OSError):
        return sum(path.stat().st_size for path in folder.iterdir())
    return 0


def _wanted() -> Path:
    folder = os.environ.get("PATCHNET_CACHE")
    return Path(folder) if folder else _platforms()


def _platforms() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or _home() / "AppData" / "Local") / "patchnet"
    if sys.platform == "darwin":
        return _home() / "Library" / "Caches" / "patchnet"
    return Path(os.environ.get("XDG_CACHE_HOME") or _home() / ".cache") / "patchnet"


def _home() -> Path:
    try:
        return Path.home()
    except RuntimeError:  # a user without a home, as in containers
        return Path(os.devnull)  # not writable: leads to the fallback


@cache
def _usable(wanted: Path) -> Path:
    try:
        wanted.mkdir(parents=True, exist_ok=True)
        check_writable(wanted)
    except (OSError, OutputError) as cause:
        fallback = Path(tempfile.mkdtemp(prefix="patchnet-"))
        atexit.register(shutil.rmtree, fallback, ignore_errors=True)
        system = cause if isinstance(cause, OSError) else cause.__cause__
        reason = system.strerror if isinstance(system, OSError) else cause
        _LOG.warning(
            "The cache folder %s cannot be used (%s): until this process ends, compiled kernels and light of "
            "bakes go to %s; name a folder that can be written in the preferences or in PATCHNET_CACHE",
            wanted, reason, fallback,
        )  # fmt: skip
        return fallback
    return wanted
