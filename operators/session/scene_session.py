# SPDX-License-Identifier: GPL-3.0-or-later
"""Session of a scene: the data that panel, overlay, render engine and operators share, with one lifetime.

A session ends when another file is opened, its scene is deleted, or the extension is disabled; Free Memory empties it.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent

if TYPE_CHECKING:
    from ...patchnet_addon.image.cube_map import CubeMap
    from ..pipeline.estimate import Estimate
    from .scene_result import SceneResult
    from .shown_view import ShownView


@dataclass(frozen=True)
class KeyedResult:
    """Result for rendering frames, and the key of its surface."""

    result: SceneResult
    key: str


@dataclass(frozen=True, eq=False)
class KeyedMap:
    """Map of a world, or None with the problem if Cycles cannot make one. key: of the world."""

    key: str
    map: CubeMap | None
    problem: str = ""


@dataclass(eq=False)
class SceneSession:
    """State that is kept of one scene.

    result: octree, light and codes. estimate: the last one. views: by name of their camera, for overlay and inspection.
    kept_frame: `result` with its key, once a render needs the key. made_frame: result of the last rendered frame
    with an octree of its own. world: its light in all directions.
    """

    result: SceneResult | None = None
    estimate: Estimate | None = None
    views: dict[str, ShownView] = field(default_factory=dict)
    kept_frame: KeyedResult | None = None
    made_frame: KeyedResult | None = None
    world: KeyedMap | None = None

    def free(self) -> None:
        """Drop all but the estimate."""
        self.result = self.kept_frame = self.made_frame = self.world = None
        self.views.clear()

    def free_frames(self) -> None:
        """Free the results of rendered frames."""
        self.kept_frame = self.made_frame = None


_sessions: dict[int, SceneSession] = {}  # by session_uid of the scene


def session_of(scene: bpy.types.Scene) -> SceneSession:
    """Session of a scene, a new one where there was none."""
    found = _sessions.get(scene.session_uid)
    if found is None:
        _close_deleted()
        found = _sessions[scene.session_uid] = SceneSession()
    return found


def open_sessions() -> list[SceneSession]:
    """Sessions of all scenes of the file."""
    _close_deleted()
    return list(_sessions.values())


def in_main_thread() -> bool:
    """Return whether this is the main thread, not that of a render in a window."""
    return threading.current_thread() is threading.main_thread()


def _close_deleted() -> None:
    """Close sessions of deleted scenes; only the main thread reads the file."""
    if in_main_thread():
        there = {scene.session_uid for scene in bpy.data.scenes}
        for number in [number for number in _sessions if number not in there]:
            del _sessions[number]


@persistent
def _on_load(_path: str) -> None:
    _sessions.clear()


HANDLERS = (("load_post", _on_load),)


def unregister() -> None:
    """Close all sessions."""
    _sessions.clear()
