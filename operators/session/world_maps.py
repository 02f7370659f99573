# SPDX-License-Identifier: GPL-3.0-or-later
"""World maps: the world's light in all directions, for viewports, and for renders in a window.

Cycles bakes only in Blender's main thread, and not while a viewport is drawn. So a timer makes a map, part by part, and
the scene's session keeps it with the key of the world. A render in a thread of its own waits for the map; meanwhile,
Blender's data do not change.
"""

from __future__ import annotations

import logging
import time
from contextlib import ExitStack
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
from .results import listeners, redraw_viewports
from .scene_session import KeyedMap, session_of

_AGAIN_S, _BETWEEN_S = 0.5, 0.2
_POLL_S = 0.05  # of a waiting render
_PATIENCE_S = 60.0  # after which a render stops waiting for an idle window
_ENGINE = "PATCHNET"  # as in `render_engine/engine.py`
_UNSEEN = "Black is shown behind objects: {}"
_BUSY = "Blender's window was busy for too long: render again"


@dataclass(eq=False)
class _Awaited:
    """Map that a render waits for, of the world in its graph. seen_at: time of the window's last work on it."""

    depsgraph: bpy.types.Depsgraph
    seen: SeenWorld
    key: str
    seen_at: float
    ended: bool = False


_waiting: list[str] = []  # names of scenes that wait for their maps
_awaited: _Awaited | None = None  # for a render
_making: tuple[str | _Awaited, Steps[None]] | None = None  # current map


def awaited_background(depsgraph: bpy.types.Depsgraph, camera: Camera, *, baked: bool) -> Steps[Background]:
    """Background as of `background`, for a thread that cannot bake: from a map that the window makes meanwhile.

    Black with a warning if it cannot.
    """
    global _awaited
    if depsgraph.scene.render.film_transparent:
        return Background(None)
    seen = seen_world(depsgraph, baked=baked)
    if seen.world is None:
        return Background(seen.color)
    session, key = session_of(depsgraph.scene.original), world_hash(seen.world)
    if session.world is None or session.world.key != key:
        asked = _awaited = _Awaited(depsgraph, seen, key, time.monotonic())
        _start()
        try:
            while not asked.ended and time.monotonic() - asked.seen_at < _PATIENCE_S:
                yield Progress(0, 1, f"{camera.name}: World", waiting=True)
                time.sleep(_POLL_S)
        finally:
            _awaited = None
    kept = session.world
    if kept is None or kept.map is None or kept.key != key:
        why = kept.problem if kept is not None and kept.key == key else _BUSY
        return Background(BLACK, (_UNSEEN.format(why),))
    return Background(kept.map.look(pixel_directions(camera)))


def ask_for_map(scene: bpy.types.Scene) -> None:
    """Request the map of a scene's world, in a window."""
    if bpy.app.background:
        return
    if scene.name not in _waiting:
        _waiting.append(scene.name)
    _start()


def _start() -> None:
    if not bpy.app.timers.is_registered(_make_maps):
        bpy.app.timers.register(_make_maps, first_interval=0.0)


def _make_maps() -> float | None:
    """Make one part of a map; the map of a waiting render goes first."""
    global _making
    awaited = _awaited if _awaited is not None and not _awaited.ended else None
    if job_is_running(BAKE) or (awaited is None and job_is_running()):
        return _AGAIN_S
    if _making is not None and awaited is not None and _making[0] is not awaited:
        if isinstance(_making[0], str):
            _waiting.append(_making[0])
        _end_map()
    if _making is None:
        if awaited is None and not _waiting:
            return None
        wanted = awaited or _waiting.pop()
        _making = wanted, _map_of(wanted)
    if awaited is not None:
        awaited.seen_at = time.monotonic()
    try:
        with ExitStack() as stack:
            stack.enter_context(in_window(True))
            if awaited is not None:
                stack.enter_context(quiet())
                stack.enter_context(values_of_graph(awaited.depsgraph))
            next(_making[1])
    except (StopIteration, ReferenceError):  # another file may have been opened meanwhile
        _end_map()
    except BaseException:
        _end_map()
        raise
    return _BETWEEN_S if awaited is None else 0.0


def _end_map() -> None:
    """Drop the current map."""
    global _making
    if _making is not None:
        wanted, steps = _making
        steps.close()
        _making = None
        if isinstance(wanted, _Awaited):
            wanted.ended = True


def _map_of(wanted: str | _Awaited) -> Steps[None]:
    if isinstance(wanted, _Awaited):
        yield from _kept(wanted.depsgraph.scene.original, wanted.seen, wanted.key)
    elif wanted in bpy.data.scenes:
        yield from keep_map(bpy.data.scenes[wanted])


def keep_map(scene: bpy.types.Scene) -> Steps[None]:
    """Make the map of a scene's world unless the session has it, and redraw the viewports."""
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


def _after_step(scene: bpy.types.Scene, _result: object) -> None:
    if scene.render.engine == _ENGINE:
        ask_for_map(scene)


def register() -> None:
    """Make maps after each step of a job, where our engine renders: a render in the window may come next."""
    listeners.append(_after_step)


def unregister() -> None:
    """End the current map."""
    listeners.remove(_after_step)
    _waiting.clear()
    _end_map()


TIMERS = (_make_maps,)
