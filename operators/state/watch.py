# SPDX-License-Identifier: GPL-3.0-or-later
"""Watch for changes by the user to a scene between a job's reading of it and the job's end.

Blender stays usable while a job works, as it does while it renders. What the job has read fits the scene no more then,
and light that is baked later is that of another scene.
"""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import bpy

from ...patchnet_addon.runtime.errors import SceneError

if TYPE_CHECKING:
    from .scene_state import SceneState


@dataclass
class SceneChangeMonitor:
    """State that a job has read its scene in, None before that; steps that do not fit any more, and why."""

    scene: int  # its session_uid
    state: SceneState | None = None
    changes: list[tuple[str, str, Hashable]] = field(default_factory=list)


_current: ContextVar[SceneChangeMonitor | None] = ContextVar("_current", default=None)
_watches: list[SceneChangeMonitor] = []  # of jobs that work now, for handlers, which run outside of them


@contextmanager
def watching(watch: SceneChangeMonitor) -> Iterator[None]:
    """Steps that are pulled within the block belong to the watched job."""
    token = _current.set(watch)
    try:
        yield
    finally:
        _current.reset(token)


def begin(scene: bpy.types.Scene) -> SceneChangeMonitor:
    """Watch a scene for a job that works beside a window, until `end`."""
    watch = SceneChangeMonitor(scene.session_uid)
    _watches.append(watch)
    return watch


def end(watch: SceneChangeMonitor) -> None:
    """End the watch with its job."""
    if watch in _watches:
        _watches.remove(watch)


def watches_of(scene: bpy.types.Scene) -> list[SceneChangeMonitor]:
    """Watches of jobs that have read this scene."""
    return [watch for watch in _watches if watch.scene == scene.session_uid and watch.state is not None]


def read_state(
    scene: bpy.types.Scene,
    layer: str = "",
    *,
    selected: bool = False,
    chosen: frozenset[int] | None = None,
    gloss_from_camera: bool = False,
) -> SceneState:
    """Read the scene's state, which is what the present job reads now.

    selected: selected objects alone have voxels, or those `chosen` by session_uid.
    """
    from .scene_state import scene_state

    if threading.current_thread() is threading.main_thread():
        for item in scene.objects:
            if item.mode == "EDIT":  # what is evaluated shows changes that the data have at its end alone
                item.update_from_editmode()
    state = scene_state(scene, layer, chosen if selected else None, selected=selected and chosen is None)
    if gloss_from_camera:
        state = state.seen_from_camera(scene)
    watch = _current.get()
    if watch is not None:
        watch.state, watch.changes = state, []
    return state


def changes_meanwhile() -> list[tuple[str, str, Hashable]]:
    """Steps that do not fit what the present job has read, what changed in words, and its key."""
    watch = _current.get()
    return [] if watch is None else watch.changes


def check_unchanged() -> None:
    """Raise SceneError if what the present job has read was changed."""
    for step, what, _ in changes_meanwhile():
        if step in ("surface", "light"):
            raise SceneError(
                f"{what[:1].upper()}{what[1:]} while its light was baked: start again, with the scene as it is now"
            )
