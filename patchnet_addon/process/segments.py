# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory segments of arrays that both processes map; the system frees one when neither maps it any longer.

On Linux a segment is an anonymous file, which the other process opens below /proc. Elsewhere it is a file in a private
temporary folder, and each process has a link of its own to it: a mapped file keeps its data, but not its name.
"""

from __future__ import annotations

import itertools
import mmap
import os
import shutil
import tempfile
import weakref
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

_HAS_ANONYMOUS = hasattr(os, "memfd_create")
_numbers = itertools.count()


class Place(NamedTuple):
    """Name of a segment in the process that sends it, its identity for the system, and its size in bytes."""

    path: str
    identity: tuple[int, int]
    size: int


class Segment(mmap.mmap):
    """Mapped segment. place: where the other process finds it."""

    place: Place


_mapped: weakref.WeakValueDictionary[tuple[int, int], Segment] = weakref.WeakValueDictionary()


def new_segment(size: int) -> Segment:
    """Segment of `size` bytes; raises MemoryError if there is no room."""
    if _HAS_ANONYMOUS:
        number = os.memfd_create("patchnet", os.MFD_CLOEXEC)
        path = f"/proc/{os.getpid()}/fd/{number}"
    else:
        path = str(_own_path())
        number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
    try:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(number, 0, size)  # else a write without room would end the process
        else:
            os.truncate(number, size)
    except OSError as cause:
        os.close(number)
        raise MemoryError(f"There is no room for {size:,} bytes of arrays") from cause
    return _map(number, path)


def opened(place: Place) -> Segment:
    """Segment that the other process has sent, mapped once."""
    known = _mapped.get(place.identity)
    if known is not None:
        return known
    if _HAS_ANONYMOUS:
        number = os.open(place.path, os.O_RDWR | os.O_CLOEXEC)
        return _map(number, f"/proc/{os.getpid()}/fd/{number}")
    path = str(_own_path())
    os.link(place.path, path)
    return _map(os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0)), path)


def shared_zeros(shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """Array of zeros in a segment of its own: what one process writes there, the other one reads."""
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    return np.frombuffer(new_segment(max(size, 1)), np.uint8)[:size].view(dtype).reshape(shape)


def segment_of(array: np.ndarray) -> tuple[Segment, int] | None:
    """Segment that holds an array, and the offset of its first element in bytes; None for other arrays."""
    whole = array
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    held = whole.base.obj if isinstance(whole.base, memoryview) else whole.base
    return (held, _address(array) - _address(whole)) if isinstance(held, Segment) else None


def _address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])


def _map(number: int, path: str) -> Segment:
    status = os.fstat(number)
    segment = Segment(number, status.st_size)
    segment.place = Place(path, (status.st_dev, status.st_ino), status.st_size)
    _mapped[segment.place.identity] = segment
    weakref.finalize(segment, _let_go, number, path).atexit = False
    return segment


def _let_go(number: int, path: str) -> None:
    with suppress(OSError):
        os.close(number)
    if not _HAS_ANONYMOUS:
        with suppress(OSError):  # Windows keeps it as long as it is mapped: the folder goes with the process
            os.unlink(path)


def _own_path() -> Path:
    return _folder() / str(next(_numbers))


@cache
def _folder() -> Path:
    """Private folder of this process."""
    folder = tempfile.mkdtemp(prefix="patchnet-")
    weakref.finalize(_own_path, shutil.rmtree, folder, ignore_errors=True)  # at exit
    return Path(folder)
