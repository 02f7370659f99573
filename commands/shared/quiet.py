# SPDX-License-Identifier: GPL-3.0-or-later
"""Silence Blender's and Cycles' own lines on the terminal, which would bury the progress bars."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from ...patchnet_addon.runtime.streams import is_written


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Silence stdout of the process within the block, whether Python or compiled code writes to it."""
    if not is_written(1):
        yield
        return
    _flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        _flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _flush() -> None:
    """Empty the buffers of Python and of the C library, so that no line changes sides."""
    sys.stdout.flush()
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)
