# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes by the extension itself, which make no result stale."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

_blocks = 0  # that are open now


@contextmanager
def quiet() -> Iterator[None]:
    """Mark changes within the block as the extension's own, undone in it: they make nothing stale."""
    global _blocks
    _blocks += 1
    try:
        yield
    finally:
        bpy.context.view_layer.update()
        _blocks -= 1


def is_quiet() -> bool:
    """Return whether changes are our own now."""
    return _blocks > 0
