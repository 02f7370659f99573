# SPDX-License-Identifier: GPL-3.0-or-later
"""Staleness of results: tests if they still fit the scene, and finds what changed if not.

Blender reports what its dependency graph evaluated again, which is far more than what changed, and nothing of values
that count for renders alone. So each report is compared with the state of the scene that the result was made of: what
has the same values fits again. That is bounded: after an undo, or a change of very many objects, all of a large scene
is taken for changed at first, and compared when it matters, as before a render. What takes long to compare, and is
known to have changed, is looked at again once the user pauses.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..scene_access.images import is_shown
from ..scene_access.own import is_quiet
from ..state.block_hashes import GLOSS_MOVED
from ..state.scene_state import LIGHT, SURFACE, Change, SceneState, scene_state
from ..state.watch import watches_of
from . import results
from .scene_result import SceneResult
from .scene_session import in_main_thread

_MAX_UPDATES = 1000  # compared one by one after one change
_QUICK_S = 0.5  # a comparison of everything may take so long while the user works
_BRIEF_S = 0.1  # and so long where nobody did anything
_PAUSE_S = 0.5  # after the last change
_MEMBERS = bpy.types.Scene | bpy.types.Collection
MANY = "many objects"
UNDO = "undo or redo"
_OTHER_LAYER = "view layer"  # key of such a reason, and how it begins


@persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Mark what does not fit what the user changed, and unmark what fits again."""
    result, estimate, watches = results.result_of(scene), results.estimate_of(scene), watches_of(scene)
    nothing_there = result is None and estimate is None and not watches
    if nothing_there or is_quiet() or not in_main_thread():
        return
    updates = list(islice(depsgraph.updates, _MAX_UPDATES + 1))
    many = len(updates) > _MAX_UPDATES
    if result is not None and result.state is not None:
        if many:
            _recheck_if_quick(result, scene, MANY)
        else:
            for change in changes(result.state, scene, updates, result.known_changes()):
                result.see(change)
        _look_at_layers(result, scene)
    for watch in watches:
        assert watch.state is not None
        known = {key for _, _, key in watch.changes}
        for change in changes(watch.state, scene, updates, known):
            if change.key not in known:
                watch.changes += [(step, change.text, change.key) for step in change.steps]
    if estimate is not None and estimate.state is not None:
        for change in changes(estimate.state, scene, updates, list(estimate.stale)):
            estimate.see(change)
        if many:
            estimate.stale[MANY] = MANY


def changes(
    state: SceneState, scene: bpy.types.Scene, updates: list[bpy.types.DepsgraphUpdate], known: Collection[Hashable]
) -> Iterator[Change]:
    """Compare what was reported: what does not fit any more, and what fits, for no step; known: marked keys."""
    if any(isinstance(update.id, _MEMBERS) for update in updates):
        yield from _of_scene(state, scene, known)
    else:
        yield from _gloss(state, scene)
    for update in updates:
        block = update.id.original
        if isinstance(block, _MEMBERS) or getattr(block, "is_editmode", False):  # whose data are empty until its end
            continue
        if block.session_uid in known and state.is_slow(block) and not bpy.app.background:
            look_soon()
            continue
        moved = isinstance(block, bpy.types.Object) and update.is_updated_transform and not update.is_updated_geometry
        change = state.compared(scene, block, "moved" if moved else "changed")
        if change is not None:
            yield change


def _of_scene(state: SceneState, scene: bpy.types.Scene, known: Collection[Hashable]) -> Iterator[Change]:
    """Compare what no data-block's own report tells."""
    yield from _gloss(state, scene)
    found = state.differences_of_scene(scene)
    again = {key for key in known if state.is_of_scene(key)} - {change.key for change in found}
    yield from (*found, *(Change(key, (), "") for key in again))


def _gloss(state: SceneState, scene: bpy.types.Scene) -> Iterator[Change]:
    if state.gloss_from:
        yield Change(GLOSS_MOVED, (LIGHT,) if state.gloss_has_moved(scene) else (), GLOSS_MOVED)


def _look_at_layers(result: SceneResult, scene: bpy.types.Scene) -> None:
    """Mark a result whose view layer no window shows any more, where those that are shown have other objects.

    Of a large scene nothing is said: all its objects would be looked at after each change.
    """
    assert result.state is not None
    shown = [window.view_layer.name for window in bpy.context.window_manager.windows if window.scene == scene]
    fits = not shown or result.state.layer in shown
    if not fits:
        if result.state.seconds >= _QUICK_S:
            return
        fits = any(result.state.fits_layer(scene, name) for name in shown)
    text = "" if fits else f"{_OTHER_LAYER} '{shown[0]}' shows other objects"
    result.see(Change(_OTHER_LAYER, () if fits else (SURFACE,), text))


def look_again(result: SceneResult, scene: bpy.types.Scene) -> None:
    """Recheck a result before it is used: disprove what marks it as stale, and see what Blender does not report."""
    if result.stale:
        recheck(result, scene)
    elif result.state is not None:
        for change in _of_scene(result.state, scene, ()):
            result.see(change)


def recheck(result: SceneResult, scene: bpy.types.Scene) -> None:
    """Compare all of a scene with what the result was made of: mark what does not fit, and unmark what does."""
    if result.state is None or any(item.mode == "EDIT" for item in scene.objects):  # data are empty until its end
        return
    before, now = result.state, scene_state(scene, result.state.layer, result.state.chosen)
    found = before.differences(now, scene)
    if not found and before.chosen is None:  # the same values, perhaps in new data-blocks
        result.state = replace(now, gloss_from=before.gloss_from)
    said = {key: text for step in (SURFACE, LIGHT) for key, text in result.reasons.get(step, {}).items()}
    for step in (SURFACE, LIGHT):
        result.unmark(step)
    for change in (*found, *_gloss(result.state, scene)):
        result.see(change._replace(text=said.get(change.key, change.text)))  # which may say more


def look_soon() -> None:
    """Look at what windows show once the user pauses, if that is quick; panels ask for it when they are drawn."""
    if bpy.app.background:
        return
    if bpy.app.timers.is_registered(look):
        bpy.app.timers.unregister(look)
    bpy.app.timers.register(look, first_interval=_PAUSE_S)


def look() -> None:
    """Compare results of what windows show, also with what Blender does not report."""
    for scene in {window.scene for window in bpy.context.window_manager.windows}:
        result = results.result_of(scene)
        if result is None or result.state is None or is_quiet():
            continue
        before = {step: dict(marks) for step, marks in result.reasons.items()}
        if result.state.seconds < (_BRIEF_S if result.stale else _QUICK_S):
            look_again(result, scene)
        if before != result.reasons:
            results.redraw_viewports()


def _recheck_if_quick(result: SceneResult, scene: bpy.types.Scene, reason: str) -> None:
    """Recheck a result, or of a large scene mark all as changed, for that `reason`, until the state is needed."""
    if result.state is not None and result.state.seconds < _QUICK_S:
        recheck(result, scene)
        return
    result.see(Change(reason, (SURFACE, LIGHT), reason))


@persistent
def _on_undo_post(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    """Recheck after undo or redo: what is as it was fits again; pictures that an undo removed do not count as shown."""
    result = results.result_of(scene)
    estimate = results.estimate_of(scene)
    if estimate is not None:
        estimate.stale[UNDO] = UNDO
    if result is not None:
        _recheck_if_quick(result, scene, UNDO)
        result.pictures = result.pictures and is_shown()


def _handlers() -> list[tuple[list[Any], Callable[..., None]]]:
    """Blender's lists of handlers, and what we add to them."""
    lists = bpy.app.handlers
    return [
        (lists.depsgraph_update_post, _on_change),
        (lists.frame_change_post, _on_change),
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
    if bpy.app.timers.is_registered(look):
        bpy.app.timers.unregister(look)
