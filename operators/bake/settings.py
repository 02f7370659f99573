# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that hold within a block, and are as before, set or unset, after it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy


@contextmanager
def changed(owner: bpy.types.bpy_struct, **values: Any) -> Iterator[None]:
    """Set properties of `owner` that this Blender has; afterwards each has its old value or none again."""
    names = [name for name in values if hasattr(owner, name)]
    before = {name: (owner.is_property_set(name), getattr(owner, name)) for name in names}
    try:
        for name in names:
            setattr(owner, name, values[name])
        yield
    finally:
        for name in reversed(names):
            was_set, value = before[name]
            setattr(owner, name, value)
            if not was_set:
                owner.property_unset(name)


@contextmanager
def object_mode(context: bpy.types.Context) -> Iterator[None]:
    """Object mode, and the mode from before afterwards."""
    active = context.view_layer.objects.active
    mode = active.mode if active else "OBJECT"
    if mode == "OBJECT":
        yield
        return
    with context.temp_override(active_object=active, object=active):
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        with context.temp_override(active_object=active, object=active):
            bpy.ops.object.mode_set(mode=mode)
