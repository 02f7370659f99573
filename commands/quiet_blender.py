# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender writes a line for every object it synchronises; a command's output is its own."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet_blender() -> Iterator[None]:
    """Standard output of the process, Blender's included, goes nowhere within the block; errors and bars still show."""
    _flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        _flush()
        os.dup2(kept, 1)
        os.close(nowhere)
        os.close(kept)


def _flush() -> None:
    """Empty the buffers of Python and of the C library, so that no line changes sides."""
    sys.stdout.flush()
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)
