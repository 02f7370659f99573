# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation state of kernels, for progress messages; imports nothing heavy."""

from __future__ import annotations

import time

NOTE = "compiling, once on this machine"

_count = 0
_spent_s = _since = 0.0  # total until the last compilation ended; start of the present one


def is_compiling() -> bool:
    """Return whether this process compiles a kernel; loading from the cache does not count."""
    return _count > 0


def compiling_seconds() -> float:
    """Seconds that this process has spent compiling kernels."""
    return _spent_s + (time.monotonic() - _since if _count > 0 else 0.0)


def count_compilations(by: int) -> None:
    """Count a compilation that begins (1) or ends (-1), one within the other; `kernels.py` calls it."""
    global _count, _spent_s, _since
    now = time.monotonic()
    if _count > 0:
        _spent_s += now - _since
    _count, _since = _count + by, now
