# SPDX-License-Identifier: GPL-3.0-or-later
"""Redirection of what Python and compiled code print to the process's stdout and stderr."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

_NUMBERS = {"stdout": 1, "stderr": 2}  # file descriptors


@contextmanager
def diverted(**targets: IO[bytes]) -> Iterator[None]:
    """Write to files what Python or compiled code prints to the process's `stdout` and `stderr` within the block."""
    _flush()
    copies = {_NUMBERS[name]: os.dup(_NUMBERS[name]) for name in targets}
    for name, target in targets.items():
        os.dup2(target.fileno(), _NUMBERS[name])
    try:
        yield
    finally:
        _flush()
        for number, copy in copies.items():
            os.dup2(copy, number)
            os.close(copy)


def drop_output(error: OSError) -> None:
    """Discard all further output after an error of writing; reports it unless it is a broken pipe (`| head`)."""
    if not isinstance(error, BrokenPipeError):
        with suppress(OSError):  # stderr may be what is lost
            print(f"patchnet: error: what was printed is lost ({error.strerror})", file=sys.stderr)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for number in _NUMBERS.values():
        os.dup2(nowhere, number)


def _flush() -> None:
    """Flush Python's buffers, so that no line of Python goes to the wrong file.

    Compiled code has a buffer of its own where stdout is no terminal; Blender flushes it after most of its lines.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
