# SPDX-License-Identifier: GPL-3.0-or-later
"""Interrupt a command within seconds by Ctrl-C or SIGTERM (render farms), even while Blender computes.

Python handles a signal between two of its own instructions, and a call into Blender, such as the bake of a page, is one
instruction that takes minutes. A thread receives the signal at once, since Blender releases Python's lock while it
bakes. If the main thread has not ended by a deadline, the thread removes unfinished files and ends the process. No
finished work is lost: files are replaced atomically, and finished calls of a bake are kept for the next start.

Blender without a window installs its own handler for Ctrl-C, which Python cannot see. It only sets a flag: PatchNet's
steps would not notice it, and Cycles notices it after half a minute. Within the block PatchNet's handler replaces it.
"""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Any

from .log import is_json, json_line
from .replace import remove_unfinished
from .streams import undivert

DEADLINE_S = 2.5
INTERRUPTED, TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM  # exit codes by the convention of shells
STOPPED = "interrupted; start again to continue the bake"
# Python's default handlers.
_DEFAULTS: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}


class Interrupted(KeyboardInterrupt):
    """Interruption by Ctrl-C or SIGTERM, by `exit_code`."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.exit_code = 128 + number


def exit_code_of(error: KeyboardInterrupt) -> int:
    """Exit code of a process that ends by this error."""
    return error.exit_code if isinstance(error, Interrupted) else INTERRUPTED


class _Waiting:
    """Number of nested `interrupts_wait` blocks, and the signal received meanwhile, or 0."""

    depth = 0
    heard = 0


@contextmanager
def interrupts_wait() -> Iterator[None]:
    """Delay Ctrl-C and SIGTERM until the end of the block, which calls Blender, or until the deadline.

    Blender calls Python in turn (Cycles' own code, handlers of scenes). An interruption raised there is printed as
    their error and lost, and unfinished work passes as finished.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _Waiting.depth += 1
    try:
        yield
    finally:
        _Waiting.depth -= 1
        if not _Waiting.depth and _Waiting.heard:
            number, _Waiting.heard = _Waiting.heard, 0
            raise Interrupted(number)


@contextmanager
def prompt_interrupt() -> Iterator[None]:
    """Raise `Interrupted` within the block at Ctrl-C and SIGTERM.

    If the block has not ended DEADLINE_S later, the process ends. Signals that are ignored or have another Python
    handler stay unchanged; outside the main thread nothing happens.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with ExitStack() as stack:
        heard = {number for number in _DEFAULTS if stack.enter_context(_listening(number))}
        if heard:
            _Waiting.heard = 0
            stack.enter_context(_watched(heard))
        yield


def _hear(number: int, _frame: FrameType | None) -> None:
    """Handle a signal in the main thread."""
    if _Waiting.depth:
        _Waiting.heard = number
        return
    raise Interrupted(number)


@contextmanager
def _listening(number: signal.Signals) -> Iterator[bool]:
    """Handle a signal within the block in place of Python or the host program; yields whether that is possible."""
    before = signal.getsignal(number)
    if before not in (None, _DEFAULTS[number]) or (os.name == "nt" and (before is None or number != signal.SIGINT)):
        yield False
    elif os.name == "nt":
        signal.signal(number, _hear)
        try:
            yield True
        finally:
            signal.signal(number, before)
    else:
        # Python does not see handlers of other languages: C's signal() returns them.
        c_signal = ctypes.CDLL(None).signal
        c_signal.restype, c_signal.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
        host = c_signal(number, None)
        signal.signal(number, _hear)
        try:
            yield True
        finally:
            ours = c_signal(number, host)
            signal.signal(number, _DEFAULTS[number] if before is None else before)
            if host != ours:  # not for Python's own, which C's signal() would install without interrupting system calls
                c_signal(number, host)


@contextmanager
def _watched(numbers: set[signal.Signals]) -> Iterator[None]:
    """Watch for the signals in a thread within the block."""
    listener, speaker = socket.socketpair()
    speaker.setblocking(False)
    ended = threading.Event()
    thread = threading.Thread(target=_watch, args=(listener, numbers, ended), daemon=True)
    before = signal.set_wakeup_fd(speaker.fileno(), warn_on_full_buffer=False)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        signal.set_wakeup_fd(before)
        speaker.close()


def _watch(listener: socket.socket, numbers: set[signal.Signals], ended: threading.Event) -> None:
    """Wait for a signal, then up to DEADLINE_S for the end of the block."""
    with listener:
        while heard := listener.recv(1):
            if heard[0] in numbers:
                if not ended.wait(DEADLINE_S):
                    end_process(128 + heard[0], STOPPED)
                return


def end_process(exit_code: int, said: str) -> None:
    """Remove unfinished files, print `said` and end the process at once."""
    try:
        remove_unfinished()
        undivert()
        # Without the log: the computing thread may be writing a line.
        line = json_line("error", said, logging.ERROR, exit_code=exit_code) if is_json() else f"\npatchnet: {said}"
        with suppress(OSError, ValueError, AttributeError):  # stderr may be closed
            print(line, file=sys.stderr, flush=True)
    finally:
        os._exit(exit_code)
