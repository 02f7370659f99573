# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C ends a command within seconds, also while Blender computes.

Python acts on Ctrl-C only between two of its own instructions, and a call into Blender, such as the bake of a page, is
one of them for minutes. A thread of ours hears of the signal at once (Blender lets threads run while it bakes); if the
main thread has not ended by a deadline, it removes unfinished files and ends the process. Nothing else is lost: files
appear complete or not at all, and finished pages of a bake stay for the next start.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..patchnet_addon.unfinished import remove_unfinished

DEADLINE_S = 2.5
INTERRUPTED = 130


@contextmanager
def prompt_interrupt(end: Callable[[], None] | None = None) -> Iterator[None]:
    """Within the block, Ctrl-C calls `end` if the block has not ended DEADLINE_S after it; by default the process ends.

    Does nothing where somebody else handles the signal, and outside the main thread.
    """
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    listener, speaker = socket.socketpair()
    speaker.setblocking(False)
    ended = threading.Event()
    thread = threading.Thread(target=_watch, args=(listener, ended, end or _end_process), daemon=True)
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
    print("\npatchnet: interrupted; a bake goes on where it was when it is started again", file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)
