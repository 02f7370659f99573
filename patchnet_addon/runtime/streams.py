# SPDX-License-Identifier: GPL-3.0-or-later
"""Standard streams that are closed (`>&-`) or broken pipes (`| head -1`): a job continues, since its results are files.

Without this, the first file that is opened gets the number of a closed stream, and receives what Blender prints.
"""

from __future__ import annotations

import ctypes
import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any, TextIO

_NAMES = ("stdin", "stdout", "stderr")  # by their file descriptors
_diverted: dict[int, int] = {}  # copies of file descriptors that are redirected for a while
_lost: list[OSError] = []  # errors of writing, which argparse ignores when it prints help


def keep_streams() -> None:
    """Open closed ones of stdin, stdout and stderr on the null device, and ignore broken pipes.

    Streams that were replaced stay as they are.
    """
    for number, name in enumerate(_NAMES):
        _open_if_closed(number)
        stream = getattr(sys, name)
        if stream is not None and (stream is not getattr(sys, f"__{name}__") or os.name == "nt"):
            continue  # Windows writes to consoles by a class of its own
        if name == "stdin":
            sys.stdin = stream or open(number, encoding="utf-8", closefd=False)  # noqa: SIM115  for the process's life
        else:
            setattr(sys, name, _patient(stream, number))


def _open_if_closed(number: int) -> None:
    try:
        os.fstat(number)
    except OSError:
        _drop(number)
        os.set_inheritable(number, True)


def _patient(stream: TextIO | None, number: int) -> TextIO:
    """Stream like `stream` that drops its output once the pipe is broken."""
    raw = _Pipe(number, "w", closefd=False)
    if stream is None:
        return io.TextIOWrapper(io.BufferedWriter(raw), encoding="utf-8", errors="backslashreplace")
    stream.flush()
    like: Any = stream
    buffer: Any = raw if like.write_through else io.BufferedWriter(raw)  # as Python's -u has it
    return io.TextIOWrapper(
        buffer,
        encoding=like.encoding,
        errors=like.errors,
        line_buffering=like.line_buffering,
        write_through=like.write_through,
    )


def finish_streams() -> OSError | None:
    """Flush stdout and stderr before the process ends; returns the first error of writing so far."""
    failed = _lost[0] if _lost else None
    for number, stream in ((1, sys.stdout), (2, sys.stderr)):
        try:
            if stream is not None and not stream.closed:
                stream.flush()
        except OSError as error:
            failed = failed or error
            _drop(number)
            with suppress(OSError):
                stream.flush()
    return failed


def _drop(number: int) -> None:
    """Redirect a file descriptor to the null device, also for compiled code."""
    nothing = os.open(os.devnull, os.O_RDWR)
    if nothing != number:
        os.dup2(nothing, number)
        os.close(nothing)


def is_written(number: int) -> bool:
    """Return whether a file descriptor can be written: the number of a closed stream may belong to another file."""
    if os.name == "nt":
        return True
    import fcntl

    try:
        return fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE != os.O_RDONLY
    except OSError:
        return False


@contextmanager
def diverted(**targets: IO[bytes]) -> Iterator[None]:
    """Write to files what Python or compiled code prints to the process's `stdout` and `stderr` within the block."""
    _flush()
    before = dict(_diverted)
    for number, name in enumerate(_NAMES):
        if name in targets and is_written(number):
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


class _Pipe(io.FileIO):
    """Raw stdout or stderr that drops output after a broken pipe; other errors name the stream."""

    def write(self, data: Any) -> int | None:  # type: ignore[override]
        try:
            return super().write(data)
        except BrokenPipeError:
            _drop(self.fileno())
            return memoryview(data).nbytes
        except OSError as error:
            if error.errno == errno.EBADF:  # closed, and its number now belongs to a file that is only read
                return memoryview(data).nbytes
            named = OSError(error.errno, error.strerror, _NAMES[self.fileno()])
            _lost.append(named)
            raise named from error
