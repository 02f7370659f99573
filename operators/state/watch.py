# SPDX-License-Identifier: GPL-3.0-or-later
"""Monitor of the user's edits to a scene between a job's reading of it and the job's end.

Blender stays usable while a job works, as it does while it renders. After an edit, the surface that the job has read no
longer fits the scene, and light that is baked later belongs to another scene.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

import bpy

from ...patchnet_addon.runtime.errors import SceneError
from .block_hashes import place_of_gloss
from .scene_state import Change, SceneState, scene_state

_monitor: SceneChangeMonitor | None = None  # of the job in a window


@dataclass
class SceneChangeMonitor:
    """State of the scene when a job read it, None before that; edited: Blender reported an update since.

    scene: its session_uid.
    """

    scene: int
    state: SceneState | None = None
    edited: bool = False


def begin(scene: bpy.types.Scene) -> None:
    """Monitor a scene for the job in a window, until `end`."""
    global _monitor
    _monitor = SceneChangeMonitor(scene.session_uid)


def end() -> None:
    """End the monitor with its job."""
    global _monitor
    _monitor = None


def note_update(scene: bpy.types.Scene) -> None:
    """Note that Blender reported an update of a scene, to compare it later."""
    if _monitor is not None and _monitor.scene == scene.session_uid:
        _monitor.edited = True


def read_state(
    scene: bpy.types.Scene,
    layer: str = "",
    *,
    selected: bool = False,
    chosen: frozenset[int] | None = None,
    gloss_from_camera: bool = False,
) -> SceneState:
    """Read the scene's state, as the current job reads it now.

    selected: selected objects alone have voxels, or those `chosen` by session_uid.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if is_main:
        for item in scene.objects:
            if item.mode == "EDIT":  # evaluated objects show edits that the mesh data lack until Edit Mode ends
                item.update_from_editmode()
    state = scene_state(scene, layer, chosen if selected else None, selected=selected and chosen is None)
    if gloss_from_camera:
        state = replace(state, gloss_from=place_of_gloss(scene))
    if _monitor is not None and is_main:
        _monitor.state, _monitor.edited = state, False
    return state


def changes_meanwhile() -> list[Change]:
    """List changes of the scene since the current job read it; none in Edit Mode, in which mesh data are empty."""
    if _monitor is None or _monitor.state is None or not _monitor.edited:
        return []
    scene = next(each for each in bpy.data.scenes if each.session_uid == _monitor.scene)
    if any(item.mode == "EDIT" for item in scene.objects):
        return []
    now = scene_state(scene, _monitor.state.layer, _monitor.state.chosen)
    return _monitor.state.differences(now, scene)


def check_unchanged() -> None:
    """Raise SceneError if the scene changed since the current job read it."""
    for change in changes_meanwhile():
        raise SceneError(f"{change.text[:1].upper()}{change.text[1:]} while its light was baked: start the bake again")
