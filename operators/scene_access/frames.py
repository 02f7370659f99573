# SPDX-License-Identifier: GPL-3.0-or-later
"""Frame iteration over a scene, with the user's frame restored afterwards.

Setting a frame overwrites animated properties, and so discards values that the user changed without a keyframe. These
are restored, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import bpy

from .overrides import put_back_when_saved
from .own import quiet

_UNREADABLE = (AttributeError, IndexError, KeyError, TypeError, ValueError)


@contextmanager
def kept_frame(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore the scene's frame after the block, and in files that are saved meanwhile."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    gone_to = frame
    before = list(_animated_values())

    def restore() -> None:
        with suppress(ReferenceError), quiet():  # another file may have been opened meanwhile
            scene.frame_set(frame, subframe=subframe)
            _restore(before)

    def put_back() -> None:
        nonlocal gone_to
        gone_to = scene.frame_current
        restore()

    try:
        with put_back_when_saved(put_back, lambda: scene.frame_set(gone_to)):
            yield
    finally:
        restore()


@contextmanager
def kept_values() -> Iterator[None]:
    """Restore animated values after the block, which evaluates other frames in another scene."""
    before = list(_animated_values())
    try:
        yield
    finally:
        with quiet():
            _restore(before)


def _restore(values: list[tuple[bpy.types.ID, bpy.types.ID, str, int, Any]]) -> None:
    """Set what `_animated_values` was, where it is another value now."""
    for _, owner, path, index, value in values:
        with suppress(ReferenceError, *_UNREADABLE):
            if _get(owner, path, index) != value:
                _set(owner, path, index, value)


@contextmanager
def values_of_graph(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Let data-blocks hold the animated values that a graph has evaluated, within the block.

    The graph of a rendered animation does not write them back. Without this, a bake, which reads the data-blocks again
    without evaluating keyframes, uses the frame that the file was left at.
    """
    before = []
    for block, owner, path, index, value in _animated_values():
        with suppress(*_UNREADABLE):
            evaluated = block.evaluated_get(depsgraph)
            shown = _get(evaluated if owner == block else evaluated.node_tree, path, index)
            if shown != value:
                before.append((owner, path, index, value))
                _set(owner, path, index, shown)
    try:
        yield
    finally:
        for each in before:
            with suppress(ReferenceError, *_UNREADABLE):
                _set(*each)


def _animated_values() -> Iterator[tuple[bpy.types.ID, bpy.types.ID, str, int, Any]]:
    """Data-block, owner (it or its node tree), path, index and current value of each property with keyframes."""
    for block in bpy.data.user_map():  # all data-blocks
        for owner in (block, getattr(block, "node_tree", None)):
            animation = getattr(owner, "animation_data", None)
            for curve in fcurves(animation) if animation is not None else ():
                path, index = curve.data_path, curve.array_index
                with suppress(*_UNREADABLE):  # keyframes of a deleted property
                    yield block, owner, path, index, _get(owner, path, index)


def fcurves(animation: bpy.types.AnimData) -> Iterator[bpy.types.FCurve]:
    """Curves of the action and of the strips of non-linear animation."""
    actions = [animation.action, *(strip.action for track in animation.nla_tracks for strip in track.strips)]
    for action in dict.fromkeys(action for action in actions if action is not None):
        for layer in action.layers:
            for strip in layer.strips:
                for bag in strip.channelbags:
                    yield from bag.fcurves


def _get(owner: bpy.types.ID, path: str, index: int) -> Any:
    """Return a plain value."""
    value = owner.path_resolve(path)
    return value[index] if hasattr(value, "__len__") and not isinstance(value, str) else value


def _set(owner: bpy.types.ID, path: str, index: int, value: Any) -> None:
    if path.endswith("]"):  # a custom property, or the input of a modifier
        owner_path, key = path[: path.rindex("[")], path[path.rindex("[") + 1 : -1].strip("\"'")
        values = owner.path_resolve(owner_path) if owner_path else owner
        present = values[key]
        if hasattr(present, "__len__"):
            present[index] = value
        else:
            values[key] = value
        owner.update_tag()
        return
    owner_path, _, name = path.rpartition(".")
    holder = owner.path_resolve(owner_path) if owner_path else owner
    if hasattr(getattr(holder, name), "__len__"):
        getattr(holder, name)[index] = value
    else:
        setattr(holder, name, value)
