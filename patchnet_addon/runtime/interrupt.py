# SPDX-License-Identifier: GPL-3.0-or-later
"""Interrupt a command within seconds by Ctrl-C, or SIGTERM as render farms send it, also while Blender computes.

Python acts on a signal only between two of its own instructions, and a call into Blender, such as the bake of a page,
is one of them for minutes. A thread of ours hears of the signal at once (Blender lets threads run while it bakes); if
the main thread has not ended by a deadline, it removes unfinished files and ends the process. Nothing else is lost:
files appear complete or not at all, and finished pages of a bake stay for the next start.

A Blender without a window has a handler of its own for Ctrl-C, which Python does not know and which asks what runs to
stop: our steps would not hear of it, and Cycles hears it after half a minute. Within the block ours takes its place.
"""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Any

from .log import is_json, json_line
from .streams import undivert
from .unfinished import remove_unfinished

DEADLINE_S = 2.5
INTERRUPTED, TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM  # exit codes, as shells name a signal's end
STOPPED = "interrupted; a bake goes on where it was when it is started again"
# What Python does with these signals where no handler was set.
_DEFAULTS: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or SIGTERM: `exit_code` tells which."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.exit_code = 128 + number


def exit_code_of(error: KeyboardInterrupt) -> int:
    """Exit code of a process that this ended."""
    return error.exit_code if isinstance(error, Interrupted) else INTERRUPTED


class _Waiting:
    """Counter of blocks of `interrupts_wait`, and the signal that came meanwhile, or 0."""

    depth = 0
    heard = 0


@contextmanager
def interrupts_wait() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM wait for the end of the block, which calls Blender, or for the deadline.

    Blender calls Python in turn, such as Cycles' own and handlers of scenes: raised there, an interruption would be
    printed as an error of theirs, and lost, and what was half done would be taken for done.
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
def prompt_interrupt(end: Callable[[], None] | None = None) -> Iterator[None]:
    """Raise `Interrupted` within the block at Ctrl-C and SIGTERM.

    If that has not ended the block DEADLINE_S after it, `end` is called; by default the process ends.

    Leaves a signal alone where another handler in Python listens, or where it is ignored; does nothing
    outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with ExitStack() as stack:
        heard = {number for number in _DEFAULTS if stack.enter_context(_listening(number))}
        if heard:
            _Waiting.heard = 0
            stack.enter_context(_watched(heard, end))
        yield


def _hear(number: int, _frame: FrameType | None) -> None:
    """Handle a signal: Python calls this in the main thread."""
    if _Waiting.depth:
        _Waiting.heard = number
        return
    raise Interrupted(number)


@contextmanager
def _listening(number: signal.Signals) -> Iterator[bool]:
    """Return whether we hear a signal within the block, in place of Python or of the program that it is a part of."""
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
        # Python cannot name a handler that is not its own, nor does it notice one: C's signal() does.
        c_signal = ctypes.CDLL(None).signal
        c_signal.restype, c_signal.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
        host = c_signal(number, None)
        signal.signal(number, _hear)
        try:
            yield True
        finally:
            ours = c_signal(number, host)
            signal.signal(number, _DEFAULTS[number] if before is None else before)
            if host != ours:  # Python's own interrupts what waits, which C's signal() would not
                c_signal(number, host)


@contextmanager
def _watched(numbers: set[signal.Signals], end: Callable[[], None] | None) -> Iterator[None]:
    """Watch for the signals within the block, in a thread."""
    listener, speaker = socket.socketpair()
    speaker.setblocking(False)
    ended = threading.Event()
    thread = threading.Thread(target=_watch, args=(listener, numbers, ended, end), daemon=True)
    before = signal.set_wakeup_fd(speaker.fileno(), warn_on_full_buffer=False)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        signal.set_wakeup_fd(before)
        speaker.close()


def _watch(
    listener: socket.socket, numbers: set[signal.Signals], ended: threading.Event, end: Callable[[], None] | None
) -> None:
    """Wait for a signal, then for the end of the block, but not for long."""
    with listener:
        while heard := listener.recv(1):
            if heard[0] in numbers:
                if ended.wait(DEADLINE_S):
                    return
                if end is None:
                    end_process(128 + heard[0], STOPPED)
                else:
                    end()
                return


def end_process(exit_code: int, said: str) -> None:
    """End the process at once; what it has not finished is removed, and users or programs are told why."""
    try:
        remove_unfinished()
        undivert()
        # Not through the log: the thread that computes may be in the middle of a line.
        line = json_line("error", said, logging.ERROR, exit_code=exit_code) if is_json() else f"\npatchnet: {said}"
        with suppress(OSError, ValueError, AttributeError):  # stderr may be closed
            print(line, file=sys.stderr, flush=True)
    finally:
        os._exit(exit_code)
