# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation state of kernels, for progress messages; imports nothing heavy."""

from __future__ import annotations

import threading
import time

NOTE = "compiling, once on this machine"

_lock = threading.Lock()
_count = 0
_spent_s = _since = 0.0  # total until the last compilation ended; start of the present one


def is_compiling() -> bool:
    """Return whether a thread compiles a kernel; loading from the cache does not count."""
    return _count > 0


def compiling_seconds() -> float:
    """Seconds that this process has spent compiling kernels."""
    with _lock:
        return _spent_s + (time.monotonic() - _since if _count > 0 else 0.0)


def count_compilations(by: int) -> None:
    """Count a compilation that begins (1) or ends (-1); called by `kernels.py`."""
    global _count, _spent_s, _since
    with _lock:
        now = time.monotonic()
        if _count > 0:
            _spent_s += now - _since
        _count, _since = _count + by, now
