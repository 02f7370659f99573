# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether results still fit the scene, and what changed if not. Looks at a bounded number of changes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import results
from .images import is_shown
from .own import is_own
from .results import SceneResult

# Object types whose change changes the surface that was voxelized.
_SURFACE_TYPES = frozenset({"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "EMPTY", "POINTCLOUD", "VOLUME"})
_LIGHT_TYPES = frozenset({"LIGHT", "LIGHT_PROBE"})
_MOST_UPDATES = 1000  # looked at after one change; who changes more has changed everything
MANY = "many objects"
UNDO = "undo or redo"

_judged = False  # the next update comes from an undo, which was looked at already


@persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Mark what was changed by the person."""
    global _judged
    result, estimate = results.result_of(scene), results.estimate_of(scene)
    if _judged:
        _judged = False
        if result is not None:  # once more: if Blender said nothing after the undo, this is a change of the person's
            _judge(result, scene)
        return
    if (result is None and estimate is None) or results.is_quiet():
        return
    for step, what in _changes(depsgraph.updates):
        if result is not None and (step != results.VIEW or result.lookahead_share is not None):
            result.mark(step, what)
        if estimate is not None:
            estimate.stale_because = estimate.stale_because or what


def _changes(updates: Iterable[bpy.types.DepsgraphUpdate]) -> Iterable[tuple[str, str]]:
    """Steps that need what changed, and what it is."""
    count = 0
    for update in islice(updates, _MOST_UPDATES + 1):
        count += 1
        item = update.id
        if is_own(item):
            continue
        if isinstance(item, bpy.types.Object):
            moved = update.is_updated_transform
            verb = "moved" if moved and not update.is_updated_geometry else "changed"
            if (moved or update.is_updated_geometry) and item.type in _SURFACE_TYPES:
                yield "surface", f"'{item.name}' {verb}"
            elif item.type in _LIGHT_TYPES:
                yield "light", f"lamp '{item.name}' {verb}"
            elif item.type == "CAMERA" and moved:
                yield "view", f"camera '{item.name}' moved"
        elif isinstance(item, bpy.types.Material):
            yield "light", f"material '{item.name}' changed"
        elif isinstance(item, bpy.types.World):
            yield "light", f"world '{item.name}' changed"
        elif isinstance(item, bpy.types.Light):
            yield "light", f"lamp '{item.name}' changed"
        elif isinstance(item, bpy.types.Camera):
            yield "view", f"camera '{item.name}' changed"
    if count > _MOST_UPDATES:
        yield "surface", MANY
        yield "light", MANY


@persistent
def _on_undo_post(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    """After undo or redo Blender reports every object as changed: compare with the scene that the result was made of.

    What is as it was then fits again. Pictures that an undo has taken away are not shown as there.
    """
    global _judged
    result = results.result_of(scene)
    estimate = results.estimate_of(scene)
    if estimate is not None:
        estimate.stale_because = estimate.stale_because or UNDO
    if result is None:
        return
    _judge(result, scene)
    result.pictures = result.pictures and is_shown()
    _judged = result.state is not None


def _judge(result: SceneResult, scene: bpy.types.Scene) -> None:
    from .scene_state import scene_state

    if result.state is None:
        return
    now = scene_state(scene)
    for step in ("surface", "light"):
        if now is not None and getattr(now, step) == getattr(result.state, step):
            result.unmark(step)
        elif step not in result.stale:
            result.mark(step, UNDO)


def _handlers() -> list[tuple[list[Any], Callable[..., None]]]:
    """Blender's lists of handlers, and what we add to them."""
    lists = bpy.app.handlers
    return [
        (lists.depsgraph_update_post, _on_change),
        (lists.undo_post, _on_undo_post),
        (lists.redo_post, _on_undo_post),
    ]


def register() -> None:
    """Listen to changes of scenes."""
    for handlers, function in _handlers():
        handlers.append(function)


def unregister() -> None:
    """Stop listening."""
    for handlers, function in reversed(_handlers()):
        handlers.remove(function)
