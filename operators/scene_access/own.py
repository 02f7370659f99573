# SPDX-License-Identifier: GPL-3.0-or-later
"""Data-blocks and changes that are the extension's own: no part of the scene that is read, lit and watched for changes.

The data-blocks are those that operators leave in a file on purpose: pictures, and the object that shows voxels.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ...patchnet_addon.runtime.errors import SceneError

OWNER = "patchnet_result"  # custom property that marks a data-block as ours to overwrite
_blocks = 0  # of `quiet` that are open now


def is_own(item: bpy.types.ID) -> bool:
    """Return whether an operator of ours made this data-block, original or evaluated, as a result."""
    return OWNER in item


@contextmanager
def quiet() -> Iterator[None]:
    """Mark changes within the block as the extension's own, undone in it: they make nothing stale."""
    global _blocks
    _blocks += 1
    try:
        yield
    finally:
        _update_layer()
        _blocks -= 1


def _update_layer() -> None:
    """Update what the context shows. Blender crashes where an override holds a layer of another scene than is shown."""
    context = bpy.context
    if context.view_layer in context.scene.view_layers.values():
        context.view_layer.update()
    elif context.window is not None:
        context.window.view_layer.update()


def check_own_scene(scene: bpy.types.Scene) -> None:
    """Raise SceneError for a scene that belongs to another file: nothing can be put into it, not for a moment."""
    if scene.library is not None:
        raise SceneError(
            f"Scene '{scene.name}' is linked from {scene.library.filepath}, and what is linked cannot be changed: "
            "open that file, or make the scene local"
        )


def is_quiet() -> bool:
    """Return whether changes are our own now."""
    return _blocks > 0
