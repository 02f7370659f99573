# SPDX-License-Identifier: GPL-3.0-or-later
"""Recognition of the main thread, which alone may use Blender's data and graphics context."""

from __future__ import annotations

from contextvars import ContextVar

_is_main = ContextVar("main_thread", default=False)
_is_main.set(True)  # by the main thread, which imports this; threads that Blender makes have a context of their own


def in_main_thread() -> bool:
    """Return whether this is the main thread, not that of a render in a window."""
    return _is_main.get()
