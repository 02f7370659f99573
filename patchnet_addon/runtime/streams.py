# SPDX-License-Identifier: GPL-3.0-or-later
"""Redirection of what Python and compiled code print to the process's stdout and stderr."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

_NUMBERS = {"stdout": 1, "stderr": 2}  # file descriptors
_diverted: dict[int, int] = {}  # copies of file descriptors that are redirected for a while


@contextmanager
def diverted(**targets: IO[bytes]) -> Iterator[None]:
    """Write to files what Python or compiled code prints to the process's `stdout` and `stderr` within the block."""
    _flush()
    before = dict(_diverted)
    for name, target in targets.items():
        number = _NUMBERS[name]
        _diverted[number] = os.dup(number)
        os.dup2(target.fileno(), number)
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


def drop_output(error: OSError) -> None:
    """Discard all further output after an error of writing; reports it unless it is a broken pipe (`| head`)."""
    if not isinstance(error, BrokenPipeError):
        with suppress(OSError):  # stderr may be what is lost
            print(f"patchnet: error: what was printed is lost ({error.strerror})", file=sys.stderr)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for number in _NUMBERS.values():
        os.dup2(nowhere, number)


def _flush() -> None:
    """Flush the buffers of Python and of the C library, so that no line goes to the wrong file."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)
