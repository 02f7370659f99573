# SPDX-License-Identifier: GPL-3.0-or-later
"""Standard streams whose reader is gone, as with `>&-` or `| head -1`: the work goes on, and ends as it would.

Without this, the first file that is opened would take the place of a stream that is closed, and get what Blender
prints; and a line without a reader would end the work, although its results are files.
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
_diverted: dict[int, int] = {}  # copies of file descriptors that lead elsewhere for a while
_lost: list[OSError] = []  # why something was not written: argparse, for one, says nothing when its help is lost


def keep_streams() -> None:
    """Open those of stdin, stdout and stderr that are closed on nothing, and let a pipe without a reader be no error.

    Does nothing to streams that were replaced.
    """
    for number, name in enumerate(_NAMES):
        _open_if_closed(number)
        stream = getattr(sys, name)
        if stream is not None and (stream is not getattr(sys, f"__{name}__") or os.name == "nt"):
            continue  # of Windows: it writes to consoles in a way of its own
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
    """Stream like `stream` that drops what is not read."""
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
    """Write what is not written yet, before the process ends; the first error of a stream, also one of before."""
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
    """Let a file descriptor lead to nothing, for what compiled code writes, too."""
    nothing = os.open(os.devnull, os.O_RDWR)
    if nothing != number:
        os.dup2(nothing, number)
        os.close(nothing)


def is_written(number: int) -> bool:
    """Test whether a file descriptor can be written: that of a closed stream may be another file's by now."""
    if os.name == "nt":
        return True
    import fcntl

    try:
        return fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE != os.O_RDONLY
    except OSError:
        return False


@contextmanager
def diverted(**targets: IO[bytes]) -> Iterator[None]:
    """Send to files what Python or compiled code writes to the process's `stdout` and `stderr` within the block."""
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
    """Let streams lead to where they did before `diverted`: the process ends within its block."""
    for number, copy in _diverted.items():
        os.dup2(copy, number)


def _flush() -> None:
    """Empty the buffers of Python and of the C library, so that no line changes sides."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)


class _Pipe(io.FileIO):
    """Pipe to stdout or stderr, and to nothing once its reader is gone; other errors name the stream."""

    def write(self, data: Any) -> int | None:  # type: ignore[override]
        try:
            return super().write(data)
        except BrokenPipeError:
            _drop(self.fileno())
            return memoryview(data).nbytes
        except OSError as error:
            if error.errno == errno.EBADF:  # it was closed, and now belongs to a file that is only read
                return memoryview(data).nbytes
            named = OSError(error.errno, error.strerror, _NAMES[self.fileno()])
            _lost.append(named)
            raise named from error
