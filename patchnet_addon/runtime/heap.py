# SPDX-License-Identifier: GPL-3.0-or-later
"""Process memory: its size, and return of freed memory to the system.

Blender has its own allocator: TBB's on Windows and in Debian's build, jemalloc in the official builds for Linux. They
keep large freed blocks for later arrays of the same size: without `trim`, a viewport held 1.3 GB of them after some
minutes of orbiting.
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
    """Return free memory of this process's allocators (TBB, jemalloc, glibc) to the system."""
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
    """Let TBB's allocator reuse freed memory before it takes more from the system, as other allocators do.

    By default its caches keep freed arrays for arrays of the same size only. Small blocks then spread over the whole
    heap, and `trim` can return little of it.
    """
    for library in _with_tbb():
        mode = getattr(library, "scalable_allocation_mode", None)
        if mode is not None:
            mode.argtypes = [ctypes.c_int, ctypes.c_ssize_t]
            mode(_TBB_SOFT_LIMIT, 1)  # byte: caches are emptied before the heap grows


def page_out(library: str) -> None:
    """Return unchanged pages of libraries whose file name contains `library` to the system, on Linux.

    They are read again on demand. A compiler keeps 100 MB of its file in memory, and hardly needs it once kernels are
    loaded.
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


def _clean_tbb() -> None:
    for library in _with_tbb():
        clean = getattr(library, "scalable_allocation_command", None)
        if clean is not None:
            clean(_TBB_ALL_BUFFERS, None)


def _with_tbb() -> tuple[Any, ...]:
    """Libraries that may contain TBB's allocator, or None."""
    return _loaded(None), _loaded("tbbmalloc.dll") if sys.platform == "win32" else None


@functools.cache
def _loaded(name: str | None) -> Any:
    """Load a library of this process, or the program itself (None); None if that fails."""
    try:
        return ctypes.CDLL(name)
    except (OSError, TypeError):  # Windows has no handle of the program
        return None


def resident_bytes() -> int | None:
    """Resident memory of this process in bytes; None except on Linux."""
    return system_bytes("/proc/self/status", "VmRSS")


def peak_bytes() -> int | None:
    """Peak of resident memory in bytes, since the start or the last reset of the kernel's counter."""
    return system_bytes("/proc/self/status", "VmHWM")


def system_bytes(file: str, name: str) -> int | None:
    """Value of a line of a file of Linux' /proc in bytes, or None."""
    with suppress(OSError), open(file, encoding="ascii", errors="replace") as lines:
        for line in lines:
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) * 1024
    return None
