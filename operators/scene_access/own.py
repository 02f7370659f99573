# SPDX-License-Identifier: GPL-3.0-or-later
"""Data-blocks and changes of the extension itself, which do not count as part of the scene.

The data-blocks are results that operators leave in a file: pictures, and the object that shows voxels.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ...patchnet_addon.runtime.errors import SceneError

OWNER = "patchnet_result"  # custom property of our data-blocks, which may be overwritten
_blocks = 0  # of `quiet` that are open now


def is_own(item: bpy.types.ID) -> bool:
    """Return whether this data-block, original or evaluated, is a result of our operators."""
    return OWNER in item


@contextmanager
def quiet() -> Iterator[None]:
    """Mark changes within the block as the extension's own, undone in it: they make no result stale."""
    global _blocks
    _blocks += 1
    try:
        yield
    finally:
        _update_layer()
        _blocks -= 1


def _update_layer() -> None:
    """Update the shown view layer. Blender crashes if an override holds a layer of a scene that is not shown."""
    context = bpy.context
    if context.view_layer in context.scene.view_layers.values():
        context.view_layer.update()
    elif context.window is not None:
        context.window.view_layer.update()


def check_own_scene(scene: bpy.types.Scene) -> None:
    """Raise SceneError for a scene that is linked from another file: nothing can be added to it."""
    if scene.library is not None:
        raise SceneError(
            f"Scene '{scene.name}' is linked from {scene.library.filepath} and cannot be changed: "
            "open that file, or make the scene local"
        )


def is_quiet() -> bool:
    """Return whether a `quiet` block is open."""
    return _blocks > 0
