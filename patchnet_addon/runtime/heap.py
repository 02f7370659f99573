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
from contextlib import suppress
from typing import Any

_TBB_ALL_BUFFERS = 0  # TBBMALLOC_CLEAN_ALL_BUFFERS of oneTBB's scalable_allocator.h
_TBB_SOFT_LIMIT = 1  # TBBMALLOC_SET_SOFT_HEAP_LIMIT
_MADV_PAGEOUT = 21  # of Linux 5.4 and newer
_JEMALLOC_PURGE = b"arena.4096.purge"  # MALLCTL_ARENAS_ALL is 4096


def trim() -> None:
    """Return what is free in the allocators of this process to the system; those that are not there are left out."""
    _clean_tbb()
    program = _loaded(None)
    for name in ("mallctl", "je_mallctl"):
        control = getattr(program, name, None)
        if control is not None:
            control.argtypes = [ctypes.c_char_p, *[ctypes.c_void_p] * 3, ctypes.c_size_t]
            control(_JEMALLOC_PURGE, None, None, None, 0)
    if sys.platform == "linux":
        glibc = getattr(program, "malloc_trim", None)
        if glibc is not None:
            glibc(0)


@functools.cache
def reuse_freed_memory() -> None:
    """Let TBB's allocator use what was freed before it asks the system for more; others do so anyway.

    Its caches keep freed arrays for later ones of the very same size, while other sizes take new memory. Small blocks
    that live on are then spread over all of it, so that `trim` can give little back.
    """
    for library in _with_tbb():
        mode = getattr(library, "scalable_allocation_mode", None)
        if mode is not None:
            mode.argtypes = [ctypes.c_int, ctypes.c_ssize_t]
            mode(_TBB_SOFT_LIMIT, 1)  # byte: caches are emptied whenever they are in the way


def _clean_tbb() -> None:
    for library in _with_tbb():
        clean = getattr(library, "scalable_allocation_command", None)
        if clean is not None:
            clean(_TBB_ALL_BUFFERS, None)


def _with_tbb() -> tuple[Any, ...]:
    """Libraries that may have TBB's allocator, or None."""
    return _loaded(None), _loaded("tbbmalloc.dll") if sys.platform == "win32" else None


def page_out(library: str) -> None:
    """Give back the unchanged pages of libraries whose file's name has this text; they are read again when needed.

    Does nothing where the system has no way to do it (only Linux has). A compiler that loads what it once compiled has
    70 MB of its file in memory, and needs next to nothing of that afterwards.
    """
    advise = getattr(_loaded(None), "madvise", None) if sys.platform == "linux" else None
    if advise is None:
        return
    advise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    with suppress(OSError), open("/proc/self/maps", encoding="utf-8", errors="replace") as file:
        for line in file:
            span, access, *_, path = line.split(maxsplit=5)
            if library in path.rpartition("/")[2] and "w" not in access:
                begin, end = (int(number, 16) for number in span.split("-"))
                advise(begin, end - begin, _MADV_PAGEOUT)


@functools.cache
def _loaded(name: str | None) -> Any:
    """Load a library that this process has, or the program itself; None where that cannot be had."""
    try:
        return ctypes.CDLL(name)
    except (OSError, TypeError):  # Windows has no handle of the program itself
        return None


def resident_bytes() -> int | None:
    """Bytes of this process that are in memory now; None where the system does not say (only Linux does)."""
    return _status_bytes("VmRSS")


def peak_bytes() -> int | None:
    """Peak of resident bytes so far, or since the kernel was told to count anew."""
    return _status_bytes("VmHWM")


def _status_bytes(name: str) -> int | None:
    """Bytes by a line of /proc/self/status, or None."""
    try:
        with open("/proc/self/status", encoding="ascii", errors="replace") as file:
            for line in file:
                if line.startswith(f"{name}:"):
                    return int(line.split()[1]) * 1024
    except OSError:
        pass
    return None
