# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation state of kernels, so that users can be told why it takes long; imports nothing heavy."""

from __future__ import annotations

import threading
import time

NOTE = "compiling, once on this machine"

_lock = threading.Lock()
_count = 0
_spent_s = _since = 0.0  # until the last compilation ended, and when the one that runs began


def is_compiling() -> bool:
    """Return whether a kernel is compiled in some thread; one that is loaded from the cache is not."""
    return _count > 0


def compiling_seconds() -> float:
    """Seconds of this process in which kernels were compiled."""
    with _lock:
        return _spent_s + (time.monotonic() - _since if _count > 0 else 0.0)


def compilation_begins() -> None:
    """Note that a compilation begins; `kernels.py` calls this."""
    _change(1)


def compilation_ends() -> None:
    """Note that a compilation has ended; `kernels.py` calls this."""
    _change(-1)


def _change(by: int) -> None:
    global _count, _spent_s, _since
    with _lock:
        now = time.monotonic()
        if _count > 0:
            _spent_s += now - _since
        _count, _since = _count + by, now
