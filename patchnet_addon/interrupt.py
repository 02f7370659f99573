# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C ends a command, or an operator without a window, within seconds, also while Blender computes.

Python acts on Ctrl-C only between two of its own instructions, and a call into Blender, such as the bake of a page, is
one of them for minutes. A thread of ours hears of the signal at once (Blender lets threads run while it bakes); if the
main thread has not ended by a deadline, it removes unfinished files and ends the process. Nothing else is lost: files
appear complete or not at all, and finished pages of a bake stay for the next start.

A Blender without a window has a handler of its own, which Python does not know and which asks what runs to stop: our
steps would not hear of it, and Cycles hears it after half a minute. Within the block Python's handler takes its place.
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
from contextlib import contextmanager

from .log import is_json, json_line
from .unfinished import remove_unfinished

DEADLINE_S = 2.5
INTERRUPTED = 130


@contextmanager
def prompt_interrupt(end: Callable[[], None] | None = None) -> Iterator[None]:
    """Within the block, Ctrl-C calls `end` if the block has not ended DEADLINE_S after it; by default the process ends.

    Does nothing where a handler of somebody else's in Python listens, and outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with _python_listens() as listens:
        if not listens:
            yield
            return
        with _watched(end or _end_process):
            yield


@contextmanager
def _python_listens() -> Iterator[bool]:
    """Whether Python's own handler hears Ctrl-C; it takes the place of one of the program that Python is a part of."""
    handler = signal.getsignal(signal.SIGINT)
    if handler not in (None, signal.default_int_handler):
        yield False
    elif os.name == "nt":
        yield handler is not None
    else:
        # Python cannot name a handler that is not its own, nor does it notice one: C's signal() does.
        c_signal = ctypes.CDLL(None).signal
        c_signal.restype, c_signal.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
        before = c_signal(signal.SIGINT, None)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            yield True
        finally:
            if c_signal(signal.SIGINT, before) == before:  # it was Python's, which interrupts what waits
                signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def _watched(end: Callable[[], None]) -> Iterator[None]:
    """A thread hears Ctrl-C within the block."""
    listener, speaker = socket.socketpair()
    speaker.setblocking(False)
    ended = threading.Event()
    thread = threading.Thread(target=_watch, args=(listener, ended, end), daemon=True)
    before = signal.set_wakeup_fd(speaker.fileno(), warn_on_full_buffer=False)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        signal.set_wakeup_fd(before)
        speaker.close()


def _watch(listener: socket.socket, ended: threading.Event, end: Callable[[], None]) -> None:
    """Wait for Ctrl-C, then for the end of the block, but not for long."""
    with listener:
        while heard := listener.recv(1):
            if heard[0] == signal.SIGINT:
                if not ended.wait(DEADLINE_S):
                    end()
                return


def _end_process() -> None:
    remove_unfinished()
    said = "interrupted; a bake goes on where it was when it is started again"
    # Not through the log: the thread that computes may be in the middle of a line.
    line = json_line("error", said, logging.ERROR, exit_code=INTERRUPTED) if is_json() else f"\npatchnet: {said}"
    print(line, file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)
