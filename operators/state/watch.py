# SPDX-License-Identifier: GPL-3.0-or-later
"""Monitor of the user's edits to a scene between a job's reading of it and the job's end.

Blender stays usable while a job works, as it does while it renders. After an edit, the surface that the job has read no
longer fits the scene, and light that is baked later belongs to another scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Steps
from ..scene_access.main_thread import in_main_thread
from ..scene_access.window_state import Part
from .block_hashes import place_of_gloss
from .scene_state import Change, SceneState, scene_state, state_steps


@dataclass(eq=False)
class SceneChangeMonitor:
    """State of the scene when the job in a window read it, None before that.

    scene: its session_uid, None while no job works. edited: Blender reported an update since.
    """

    scene: int | None = None
    state: SceneState | None = None
    edited: bool = False

    def begin(self, scene: bpy.types.Scene) -> None:
        """Monitor a scene until `end`."""
        self.scene, self.state, self.edited = scene.session_uid, None, False

    def end(self) -> None:
        """End with the job."""
        self.scene = self.state = None

    def note_update(self, scene: bpy.types.Scene) -> None:
        """Note that Blender reported an update of a scene, to compare it later."""
        self.edited |= self.scene == scene.session_uid


change_monitor = Part("change_monitor", SceneChangeMonitor)


def read_state(
    scene: bpy.types.Scene,
    layer: str = "",
    *,
    selected: bool = False,
    chosen: frozenset[int] | None = None,
) -> Steps[SceneState]:
    """Read the scene's state, as the current job reads it now.

    selected: selected objects alone have voxels, or those `chosen` by session_uid. Raises SceneError if data-blocks
    are deleted meanwhile.
    """
    monitor = change_monitor()
    watched = monitor.scene is not None and in_main_thread()
    if watched:
        monitor.state, monitor.edited = None, False  # edits between two steps of the reading count as later ones
    if in_main_thread():
        for item in scene.objects:
            if item.mode == "EDIT":  # evaluated objects show edits that the mesh data lack until Edit Mode ends
                item.update_from_editmode()
    try:
        state = yield from state_steps(scene, layer, chosen if selected else None, selected=selected and chosen is None)
    except ReferenceError as cause:
        raise SceneError("Objects were deleted while the scene was read: start again") from cause
    if watched:
        monitor.state = state
    return state


def with_gloss_from_camera(state: SceneState, scene: bpy.types.Scene) -> SceneState:
    """State that the current job has just read, with the place of the camera that gloss is baked for."""
    state, monitor = replace(state, gloss_from=place_of_gloss(scene)), change_monitor()
    if monitor.scene is not None and in_main_thread():
        monitor.state = state
    return state


def changes_meanwhile() -> list[Change]:
    """List changes of the scene since the current job read it; none in Edit Mode, in which mesh data are empty."""
    monitor = change_monitor()
    if monitor.state is None or not monitor.edited:
        return []
    scene = next(each for each in bpy.data.scenes if each.session_uid == monitor.scene)
    if any(item.mode == "EDIT" for item in scene.objects):
        return []
    changes = monitor.state.differences(scene_state(scene, monitor.state.layer, monitor.state.chosen), scene)
    monitor.edited = bool(changes)  # Blender reports updates without a change, too
    return changes


def check_unchanged() -> None:
    """Raise SceneError if the scene changed since the current job read it."""
    for change in changes_meanwhile():
        raise SceneError(f"{change.text[:1].upper()}{change.text[1:]} while its light was baked: start the bake again")
