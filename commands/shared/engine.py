# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine in Blender as a Python module, where no extension is enabled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def registered() -> Iterator[None]:
    """Register the render engine and its settings within the block, unless they are."""
    import bpy

    from ...operators import registration

    known = hasattr(bpy.types.Scene, "patchnet")
    if not known:
        registration.register()
    try:
        yield
    finally:
        if not known:
            registration.unregister()
