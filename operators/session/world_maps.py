# SPDX-License-Identifier: GPL-3.0-or-later
"""World maps: the world's light in all directions, for viewports, and for renders in a window.

Cycles bakes only in Blender's main thread, and not while a viewport is drawn. So a timer makes a map, part by part, and
the scene's session keeps it with the key of the world. A render in a thread of its own waits for the map; meanwhile,
Blender's data do not change.
"""

from __future__ import annotations

import logging
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass

import bpy

from ...patchnet_addon.image.background import BLACK
from ...patchnet_addon.image.cube_map import pixel_directions
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.log import event
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.background import Background, SeenWorld, seen_world
from ..cycles.environment import world_map
from ..scene.fingerprint import world_hash
from ..scene_access.frames import values_of_graph
from ..scene_access.own import quiet
from ..scene_access.window_job import BAKE, in_window, job_is_running
from ..scene_access.window_state import Part
from .results import redraw_viewports
from .scene_session import KeyedMap, session_of

_AGAIN_S, _BETWEEN_S = 0.5, 0.2
_POLL_S = 0.05  # of a waiting render
_PATIENCE_S = 60.0  # after which a render stops waiting for an idle window
_UNSEEN = "Black is shown behind objects: {}"
_BUSY = "Blender's window was busy for too long: render again"


@dataclass(eq=False)
class _Wanted:
    """Map to make, of a scene or of the graph of a render that waits. seen_at: time of the window's last work on it."""

    scene: str
    steps: Steps[None]
    depsgraph: bpy.types.Depsgraph | None = None
    seen_at: float = 0.0


_wanted = Part("maps", list[_Wanted])  # the last one is made first: those of renders


def awaited_background(depsgraph: bpy.types.Depsgraph, camera: Camera, *, baked: bool) -> Steps[Background]:
    """Background as of `background`, for a thread that cannot bake: from a map that the window makes meanwhile.

    Black with a warning if it cannot.
    """
    if depsgraph.scene.render.film_transparent:
        return Background(None)
    seen = seen_world(depsgraph, baked=baked)
    if seen.world is None:
        return Background(seen.color)
    session, key = session_of(depsgraph.scene.original), world_hash(seen.world)
    if session.world is None or session.world.key != key:
        scene = depsgraph.scene.original
        asked = _Wanted(scene.name, _kept(scene, seen, key), depsgraph, time.monotonic())
        _wanted().append(asked)
        _start()
        try:
            while asked in _wanted() and time.monotonic() - asked.seen_at < _PATIENCE_S:
                yield Progress(0, 1, f"{camera.name}: World", waiting=True)
                time.sleep(_POLL_S)
        finally:
            _drop(asked)
    kept = session.world
    if kept is None or kept.map is None or kept.key != key:
        why = kept.problem if kept is not None and kept.key == key else _BUSY
        return Background(BLACK, (_UNSEEN.format(why),))
    return Background(kept.map.look(pixel_directions(camera)))


def ask_for_map(scene: bpy.types.Scene) -> None:
    """Request the map of a scene's world, in a window."""
    if bpy.app.background:
        return
    if sum(each.scene == scene.name for each in _wanted()) < 2:  # one may be in the making, of the former world
        _wanted().insert(0, _Wanted(scene.name, keep_map(scene.name)))
    _start()


def _start() -> None:
    if not bpy.app.timers.is_registered(_make_maps):
        bpy.app.timers.register(_make_maps, first_interval=0.0)


def _drop(wanted: _Wanted) -> None:
    with suppress(ValueError):  # it has ended
        _wanted().remove(wanted)


def _make_maps() -> float | None:
    """Make one part of a map; the map of a waiting render goes first."""
    if not _wanted():
        return None
    wanted = _wanted()[-1]
    if job_is_running(BAKE) or (wanted.depsgraph is None and job_is_running()):
        return _AGAIN_S
    wanted.seen_at = time.monotonic()
    try:
        with ExitStack() as stack:
            stack.enter_context(in_window(True))
            if wanted.depsgraph is not None:
                stack.enter_context(quiet())
                stack.enter_context(values_of_graph(wanted.depsgraph))
            next(wanted.steps)
    except (StopIteration, ReferenceError):  # another file may have been opened meanwhile
        _drop(wanted)
    except BaseException:
        _drop(wanted)
        raise
    return _BETWEEN_S if wanted.depsgraph is None else 0.0


def keep_map(name: str) -> Steps[None]:
    """Make the map of a scene's world unless the session has it, and redraw the viewports."""
    scene = bpy.data.scenes.get(name)
    if scene is None:
        return
    layer = next((window.view_layer for window in bpy.context.window_manager.windows if window.scene == scene), None)
    depsgraph = (layer or scene.view_layers[0]).depsgraph
    if depsgraph is None:  # the scene is not evaluated yet
        return
    seen = seen_world(depsgraph, baked=False)
    session, key = session_of(scene), world_hash(seen.world)
    if seen.world is not None and (session.world is None or session.world.key != key):
        yield from _kept(scene, seen, key)


def _kept(scene: bpy.types.Scene, seen: SeenWorld, key: str) -> Steps[None]:
    """Make the map of a world, with its key, and redraw the viewports."""
    assert seen.world is not None
    session, world = session_of(scene), seen.world.original
    try:
        session.world = KeyedMap(key, (yield from world_map(world, seen.frame)))
    except PatchNetError as error:
        session.world = KeyedMap(key, None, str(error))
        event("warning", _UNSEEN.format(error), logging.WARNING)
    redraw_viewports()


TIMERS = (_make_maps,)
