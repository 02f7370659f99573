# SPDX-License-Identifier: GPL-3.0-or-later
"""Standard streams of the process: closed ones, broken pipes, and redirection of what compiled code prints."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

_NAMES = ("stdin", "stdout", "stderr")  # by their file descriptors
_diverted: dict[int, int] = {}  # copies of file descriptors that are redirected for a while


def keep_streams() -> None:
    """Open those of stdin, stdout and stderr that are closed on the null device.

    Otherwise the first file that is opened gets the number of a closed stream, and receives what Blender prints.
    """
    for number, name in enumerate(_NAMES):
        try:
            os.fstat(number)
        except OSError:
            _drop(number)
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            stream = open(number, "w" if number else "r", encoding="utf-8", closefd=False)  # noqa: SIM115  to the end
            setattr(sys, name, stream)


def finish_streams() -> OSError | None:
    """Flush stdout and stderr before the process ends; returns the first error that is not a broken pipe."""
    failed: OSError | None = None
    for number, stream in ((1, sys.stdout), (2, sys.stderr)):
        try:
            if stream is not None and not stream.closed:
                stream.flush()
        except OSError as error:
            failed = failed or (None if isinstance(error, BrokenPipeError) else error)
            _drop(number)
            with suppress(OSError):
                stream.flush()
    return failed


def _drop(number: int) -> None:
    """Redirect a file descriptor to the null device."""
    nothing = os.open(os.devnull, os.O_RDWR)
    if nothing != number:
        os.dup2(nothing, number)
        os.close(nothing)


@contextmanager
def diverted(**targets: IO[bytes]) -> Iterator[None]:
    """Write to files what Python or compiled code prints to the process's `stdout` and `stderr` within the block."""
    _flush()
    before = dict(_diverted)
    for number, name in enumerate(_NAMES):
        if name in targets:
            with suppress(OSError):  # a closed stream
                _diverted[number] = os.dup(number)
                os.dup2(targets[name].fileno(), number)
    try:
        yield
    finally:
        _flush()
        for number in [number for number, copy in _diverted.items() if before.get(number) != copy]:
            os.dup2(_diverted[number], number)
            os.close(_diverted.pop(number))
        _diverted.update(before)


def undivert() -> None:
    """Undo `diverted`, for a process that ends within its block."""
    for number, copy in _diverted.items():
        os.dup2(copy, number)


def _flush() -> None:
    """Flush the buffers of Python and of the C library, so that no line goes to the wrong file."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)
