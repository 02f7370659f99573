# SPDX-License-Identifier: GPL-3.0-or-later
"""Session of a scene: the data that panel, overlay, render engine and operators share, with one lifetime.

A session ends when another file is opened, its scene is deleted, or the extension is disabled; Free Memory empties it.
"""

from __future__ import annotations

import gc
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import bpy
from bpy.app.handlers import persistent

from ...patchnet_addon.process.computed import release
from ..scene_access.main_thread import in_main_thread
from ..scene_access.own import is_own
from ..scene_access.window_state import Part

if TYPE_CHECKING:
    from ...patchnet_addon.image.cube_map import CubeMap
    from ..pipeline.estimate import Estimate
    from .scene_result import SceneResult
    from .shown_view import ShownView


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
    made_frame: result of the last rendered frame with an octree of its own. world: its light in all directions. looked:
    the cache folder was searched for a result.
    """

    result: SceneResult | None = None
    estimate: Estimate | None = None
    views: dict[str, ShownView] = field(default_factory=dict)
    made_frame: SceneResult | None = None
    world: KeyedMap | None = None
    looked: bool = False

    def free(self) -> None:
        """Drop all but the estimate."""
        self.result = self.made_frame = self.world = None
        self.views.clear()


_sessions = Part("sessions", dict[int, SceneSession])  # by session_uid of the scene


def session_of(scene: bpy.types.Scene) -> SceneSession:
    """Session of a scene, a new one where there was none."""
    sessions = _sessions()
    found = sessions.get(scene.session_uid)
    if found is None:
        _close_deleted()
        found = sessions[scene.session_uid] = SceneSession()
    return found


def open_sessions() -> list[SceneSession]:
    """Sessions of all scenes of the file."""
    _close_deleted()
    return list(_sessions().values())


def _close_deleted() -> None:
    """Close sessions of deleted scenes; only the main thread reads the file."""
    if in_main_thread():
        there = {scene.session_uid for scene in bpy.data.scenes}
        sessions = _sessions()
        for number in [number for number in sessions if number not in there]:
            del sessions[number]


@persistent
def _on_load(_path: str) -> None:
    _sessions().clear()


HANDLERS = (("load_post", _on_load),)


class Held(NamedTuple):
    """Bytes that the extension holds.

    results: octrees, codes and views of all scenes and rendered frames. images: pictures in the file.
    """

    results: int
    images: int


def give_back() -> None:
    """Free what refers to itself, such as a preview and its unfinished steps, here and in the engine."""
    gc.collect()
    release()


def held() -> Held:
    """Measure what the extension holds now."""
    images = sum(_image_bytes(image) for image in bpy.data.images if is_own(image))
    return Held(sum(map(_session_bytes, open_sessions())), images)


def _session_bytes(session: SceneSession) -> int:
    """Bytes of octrees, codes and views of a scene."""
    results = [result for result in (session.result, session.made_frame) if result is not None]  # may share an octree
    octrees = {id(result.octree): result.octree.nbytes for result in results}
    codes = {id(result.coded): result.coded.nbytes for result in results if result.coded is not None}
    views = [array.nbytes for view in session.views.values() for array in (*view.values.values(), *view.looks.values())]
    return sum(octrees.values()) + sum(codes.values()) + sum(views)


def _image_bytes(image: bpy.types.Image) -> int:
    if not image.has_data:  # reading its size would load its pixels
        return 0
    width, height = image.size
    return width * height * image.channels * (4 if image.is_float else 1)
