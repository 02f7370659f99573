# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of this process: what it takes, and what is free in it given back to the system.

Blender brings an allocator of its own: TBB's on Windows and in Debian's build, jemalloc in the official builds for
Linux. They keep large blocks that were freed, for the next array of that size: without `trim`, a viewport that turned
for a while held 1.3 GB of them.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from typing import Any

_TBB_ALL_BUFFERS = 0  # TBBMALLOC_CLEAN_ALL_BUFFERS of oneTBB's scalable_allocator.h
_TBB_SOFT_LIMIT = 1  # TBBMALLOC_SET_SOFT_HEAP_LIMIT
_JEMALLOC_PURGE = b"arena.4096.purge"  # MALLCTL_ARENAS_ALL is 4096


def trim() -> None:
    """Return what is free in the allocators of this process to the system; those that are not there are left out."""
    for clean in _functions("scalable_allocation_command"):
        clean(_TBB_ALL_BUFFERS, None)
    for control in _functions("mallctl", "je_mallctl"):
        control.argtypes = [ctypes.c_char_p, *[ctypes.c_void_p] * 3, ctypes.c_size_t]
        control(_JEMALLOC_PURGE, None, None, None, 0)
    for glibc in _functions("malloc_trim") if sys.platform == "linux" else ():
        glibc(0)


@functools.cache
def reuse_freed_memory() -> None:
    """Let TBB's allocator use what was freed before it asks the system for more; others do so anyway.

    Its caches keep freed arrays for later ones of the very same size, while other sizes take new memory. Small blocks
    that live on are then spread over all of it, so that `trim` can give little back.
    """
    for mode in _functions("scalable_allocation_mode"):
        mode.argtypes = [ctypes.c_int, ctypes.c_ssize_t]
        mode(_TBB_SOFT_LIMIT, 1)  # byte: caches are emptied whenever they are in the way


def _functions(*names: str) -> list[Any]:
    """Functions by these names of the program itself, and on Windows of TBB's allocator; without those not there."""
    found = [getattr(_loaded(library), name, None) for library in (None, "tbbmalloc.dll") for name in names]
    return [function for function in found if function is not None]


@functools.cache
def _loaded(name: str | None) -> Any:
    """Load a library that this process has, or the program itself; None where that cannot be had."""
    if name is not None and sys.platform != "win32":
        return None
    try:
        return ctypes.CDLL(name)
    except (OSError, TypeError):  # Windows has no handle of the program itself
        return None


def resident_bytes() -> int | None:
    """Bytes of this process that are in memory now; None where the system does not say (only Linux does)."""
    return _status_bytes("VmRSS")


def peak_bytes() -> int | None:
    """Peak of resident bytes so far; None where the system does not say."""
    return _status_bytes("VmHWM")


def _status_bytes(name: str) -> int | None:
    """Bytes by a line of /proc/self/status, or None."""
    try:
        with open("/proc/self/status", encoding="ascii", errors="replace") as file:
            return next((int(line.split()[1]) * 1024 for line in file if line.startswith(f"{name}:")), None)
    except OSError:
        return None
