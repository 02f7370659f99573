# SPDX-License-Identifier: GPL-3.0-or-later
"""Session of a scene: everything that panel, overlay, render engine and operators share of it, with one lifetime.

It ends when another file is opened, its scene is deleted, or the extension is disabled; Free Memory empties it.
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
    """Result that frames are rendered from, and the key of the surface that it shows."""

    result: SceneResult
    key: str


@dataclass(frozen=True, eq=False)
class KeyedMap:
    """Map of a world; None where Cycles could not make one, with the problem. key: of the world that it shows."""

    key: str
    map: CubeMap | None
    problem: str = ""


@dataclass(eq=False)
class SceneSession:
    """State that is kept of one scene.

    result: octree, light and codes. estimate: the last one. views: by name of their camera, for overlay and inspection.
    kept_frame: `result`, once a render has asked for its key; made_frame: what was made for the last frame that needed
    an octree of its own. world: its light in all directions.
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
        """Drop what was made for frames of an animation."""
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
    """Test whether this is not the thread of a render beside a window."""
    return threading.current_thread() is threading.main_thread()


def _close_deleted() -> None:
    """Close sessions of scenes that are gone, in the main thread: others may not look at the file."""
    if in_main_thread():
        there = {scene.session_uid for scene in bpy.data.scenes}
        for number in [number for number in _sessions if number not in there]:
            del _sessions[number]


@persistent
def _on_load(_path: str) -> None:
    _sessions.clear()


def register() -> None:
    """Close all sessions when another file is opened."""
    bpy.app.handlers.load_post.append(_on_load)


def unregister() -> None:
    """Close all sessions."""
    bpy.app.handlers.load_post.remove(_on_load)
    _sessions.clear()
