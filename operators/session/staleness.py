# SPDX-License-Identifier: GPL-3.0-or-later
"""Staleness of results: whether they still fit the scene, and what changed if not.

Blender reports all that its dependency graph evaluates again, far more than the changes, and does not report values
that only renders use. So the scene's state is compared: once the user pauses, and before a job or a render uses a
result. In a scene whose state takes long to read, a reported edit marks the result until the next job or render.
"""

from __future__ import annotations

from dataclasses import replace

import bpy
from bpy.app.handlers import persistent

from ..scene_access.main_thread import in_main_thread
from ..scene_access.own import is_own, is_quiet
from ..state.block_hashes import GLOSS_MOVED, place_of_gloss
from ..state.scene_state import LIGHT, SURFACE, SceneState, scene_state
from ..state.watch import change_monitor
from . import results
from .scene_result import VIEW, SceneResult
from .scene_session import session_of
from .views import camera_change

_QUICK_S = 0.5  # longest comparison while the user works
_PAUSE_S = 0.5  # after the last change
PERHAPS = "the scene may have changed"


@persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Compare soon; mark results at once that are not compared while the user works."""
    if is_quiet() or not in_main_thread():
        return
    change_monitor().note_update(scene)
    session = session_of(scene)
    if (session.result is not None or session.estimate is not None) and _has_edits(depsgraph):
        _may_have_changed(scene)
    look_soon()


def _has_edits(depsgraph: bpy.types.Depsgraph) -> bool:
    """Return whether a report concerns more than selection or a camera."""
    return any(
        update.is_updated_transform or update.is_updated_geometry or update.is_updated_shading
        for update in depsgraph.updates
        if not (isinstance(update.id, bpy.types.Camera) or getattr(update.id, "type", "") == "CAMERA")
    )


def _may_have_changed(scene: bpy.types.Scene) -> None:
    """Mark the estimate as outdated, and a result that takes long to compare as stale."""
    session = session_of(scene)
    if session.estimate is not None:
        session.estimate.outdated = True
    if session.result is not None and session.result.state is not None and session.result.state.seconds >= _QUICK_S:
        for step in (SURFACE, LIGHT):
            session.result.mark(step, PERHAPS)


def look_again(result: SceneResult, scene: bpy.types.Scene) -> None:
    """Compare a scene with the state of a result: mark steps that do not fit, and unmark steps that do."""
    before = result.state
    if before is None or any(item.mode == "EDIT" for item in scene.objects):  # mesh data are empty in Edit Mode
        return
    now = scene_state(scene, before.layer, before.chosen)
    changes = before.differences(now, scene)
    if not changes and before.chosen is None:  # equal values, perhaps in new data-blocks
        result.state = replace(now, gloss_from=before.gloss_from)
    for step in (SURFACE, LIGHT):
        result.unmark(step)
    for change in changes:
        result.see(change)
    if before.gloss_from and place_of_gloss(scene) != before.gloss_from:
        result.mark(LIGHT, GLOSS_MOVED)
    if other := _other_layer(before, scene):
        result.mark(SURFACE, f"view layer '{other}' shows other objects")


def _other_layer(state: SceneState, scene: bpy.types.Scene) -> str:
    """Name of a view layer in a window if no window shows one with the objects of the state, else ""."""
    shown = [window.view_layer.name for window in bpy.context.window_manager.windows if window.scene == scene]
    fits = not shown or state.layer in shown or any(state.fits_layer(scene, name) for name in shown)
    return "" if fits else shown[0]


def look_soon() -> None:
    """Compare the scenes in windows once the user pauses; panels request it when they are drawn."""
    if bpy.app.background:
        return
    if bpy.app.timers.is_registered(look):
        bpy.app.timers.unregister(look)
    bpy.app.timers.register(look, first_interval=_PAUSE_S)


def look() -> None:
    """Compare results of the scenes in windows, unless that takes long, and their views."""
    for scene in {window.scene for window in bpy.context.window_manager.windows}:
        result = results.result_of(scene)
        if result is None or result.state is None or is_quiet():
            continue
        before = {step: list(reasons) for step, reasons in result.reasons.items()}
        if result.state.seconds < _QUICK_S:
            look_again(result, scene)
        result.unmark(VIEW)
        moved = [why for view in session_of(scene).views.values() if (why := camera_change(scene, view))]
        if moved and result.lookahead_share is not None:
            result.mark(VIEW, moved[0])
        if before != result.reasons:
            results.redraw_viewports()


@persistent
def _on_undo_post(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    """Compare after undo or redo, after which results may fit again; removed pictures do not count as shown."""
    _may_have_changed(scene)
    result = results.result_of(scene)
    if result is not None:
        result.pictures = result.pictures and any(map(is_own, bpy.data.images))
    look_soon()


HANDLERS = (
    ("depsgraph_update_post", _on_change),
    ("frame_change_post", _on_change),
    ("undo_post", _on_undo_post),
    ("redo_post", _on_undo_post),
)
TIMERS = (look,)
