# SPDX-License-Identifier: GPL-3.0-or-later
"""Staleness of results: tests if they still fit the scene, and finds what changed if not.

Blender reports what its dependency graph evaluated again, which is far more than what changed. So each report is
compared with the state of the scene that the result was made of. That is bounded: after an undo, or a change of very
many objects, all of a large scene is taken for changed at first, and compared when it matters, as before a render.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator
from itertools import islice
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.handlers import persistent

from ..scene_access.images import is_shown
from ..scene_access.own import is_quiet
from ..state.watch import watches_of
from . import results
from .scene_result import VIEW, SceneResult
from .scene_session import in_main_thread

if TYPE_CHECKING:
    from ..state.scene_state import SceneState

_MAX_UPDATES = 1000  # compared one by one after one change
_QUICK_S = 0.5  # a comparison of everything may take so long while the user works
_MEMBERS = bpy.types.Scene | bpy.types.Collection
MANY = "many objects"
UNDO = "undo or redo"
_OTHER_LAYER = "view layer"  # how such a reason begins


@persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Mark what does not fit what the user changed."""
    result, estimate, watches = results.result_of(scene), results.estimate_of(scene), watches_of(scene)
    nothing_there = result is None and estimate is None and not watches
    if nothing_there or is_quiet() or not in_main_thread():
        return
    updates = list(islice(depsgraph.updates, _MAX_UPDATES + 1))
    if result is not None and result.state is not None:
        if len(updates) > _MAX_UPDATES:
            _recheck_if_quick(result, scene, MANY)
        else:
            for step, what in changes(result.state, scene, updates, result.known_changes()):
                if step != VIEW or result.lookahead_share is not None:
                    result.mark(step, what)
        _look_at_layers(result, scene)
    for watch in watches:
        assert watch.state is not None
        watch.changes.extend(changes(watch.state, scene, updates, {what for _, what in watch.changes}))
    if estimate is not None and estimate.state is not None and not estimate.stale_because:
        many = len(updates) > _MAX_UPDATES
        found = next(changes(estimate.state, scene, updates, ()), ("", MANY if many else ""))
        estimate.stale_because = found[1]


def changes(
    state: SceneState, scene: bpy.types.Scene, updates: Iterable[bpy.types.DepsgraphUpdate], known: Container[str]
) -> Iterator[tuple[str, str]]:
    """Steps that do not fit what was reported, and what that is, in words; not what is `known` already."""
    from ..state.gloss_view import GLOSS_MOVED
    from ..state.scene_state import LIGHT, MEMBERS, changed_text

    if GLOSS_MOVED not in known and state.gloss_has_moved(scene):
        yield LIGHT, GLOSS_MOVED
    for update in updates:
        block = update.id.original
        if isinstance(block, _MEMBERS):
            for step in state.changes_of_members(scene):
                yield step, changed_text(MEMBERS, step=step)
        elif (what := _words(update)) not in known:
            yield from ((step, what) for step in state.changes_of(block))


def _look_at_layers(result: SceneResult, scene: bpy.types.Scene) -> None:
    """Mark a result whose view layer no window shows any more, where those that are shown have other objects.

    Of a large scene nothing is said: all its objects would be looked at after each change.
    """
    from ..state.scene_state import SURFACE

    assert result.state is not None
    shown = [window.view_layer.name for window in bpy.context.window_manager.windows if window.scene == scene]
    marked = any(text.startswith(_OTHER_LAYER) for text in result.reasons.get(SURFACE, ()))
    fits = not shown or result.state.layer in shown
    if not fits:
        if result.state.seconds >= _QUICK_S:
            return
        fits = any(result.state.fits_layer(scene, name) for name in shown)
    if fits and marked:
        recheck(result, scene)
    elif not fits:
        result.mark(SURFACE, f"{_OTHER_LAYER} '{shown[0]}' shows other objects")


def _words(update: bpy.types.DepsgraphUpdate) -> str:
    """Describe the change of a data-block that Blender reports."""
    from ..state.scene_state import changed_text, key_of

    block = update.id.original
    moved = isinstance(block, bpy.types.Object) and update.is_updated_transform and not update.is_updated_geometry
    return changed_text(key_of(block), "moved" if moved else "changed")


def look_again(result: SceneResult, scene: bpy.types.Scene) -> None:
    """Recheck a result before it is used: disprove what marks it as stale, and see what Blender does not report."""
    from ..state.gloss_view import GLOSS_MOVED
    from ..state.scene_state import LIGHT, MEMBERS, changed_text

    if result.stale:
        recheck(result, scene)
    elif result.state is not None:
        if result.state.gloss_has_moved(scene):
            result.mark(LIGHT, GLOSS_MOVED)
        for step in result.state.changes_of_members(scene):
            result.mark(step, changed_text(MEMBERS, step=step))


def recheck(result: SceneResult, scene: bpy.types.Scene) -> None:
    """Compare all of a scene with what the result was made of: mark what does not fit, and unmark what does."""
    from ..state.gloss_view import GLOSS_MOVED
    from ..state.scene_state import LIGHT, scene_state

    if result.state is None:
        return
    for step, texts in result.state.differences(scene_state(scene, result.state.layer)).items():
        result.unmark(step)
        for text in texts:
            result.mark(step, text)
    if result.state.gloss_has_moved(scene):
        result.mark(LIGHT, GLOSS_MOVED)


def _recheck_if_quick(result: SceneResult, scene: bpy.types.Scene, reason: str) -> None:
    """Recheck a result, or of a large scene mark all as changed, for that `reason`, until the state is needed."""
    from ..state.scene_state import LIGHT, SURFACE

    if result.state is not None and result.state.seconds < _QUICK_S:
        recheck(result, scene)
        return
    for step in (SURFACE, LIGHT):
        result.mark(step, reason)


@persistent
def _on_undo_post(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    """Recheck after undo or redo: what is as it was fits again; pictures that an undo removed do not count as shown."""
    result = results.result_of(scene)
    estimate = results.estimate_of(scene)
    if estimate is not None:
        estimate.stale_because = estimate.stale_because or UNDO
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
