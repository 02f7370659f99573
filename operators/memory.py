# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory back to the system after a job."""

from __future__ import annotations

import ctypes
import gc
import sys


def give_back() -> None:
    """Collect what nobody uses, and let the C library return free pages, which glibc else keeps for itself."""
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # not in every C library
        if trim is not None:
            trim(0)
