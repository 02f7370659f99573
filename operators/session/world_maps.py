# SPDX-License-Identifier: GPL-3.0-or-later
"""World maps: the world's light in all directions, for viewports, and for renders beside a window.

Cycles bakes in Blender's main thread, and not while a viewport is drawn. So a map is made by a timer, as soon as a
window has time, part by part, and kept in the scene's session with the key of the world that it shows.
"""

from __future__ import annotations

import logging

import bpy

from ...patchnet_addon.image.background import BLACK
from ...patchnet_addon.image.cube_map import pixel_directions
from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.log import event
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.world.background import Background, SeenWorld, seen_world
from ..cycles.world.environment import world_map
from ..scene_access.window_job import in_window, job_is_running
from ..state.digest import Digest
from .results import listeners
from .scene_session import KeyedMap, session_of

_AGAIN_S, _BETWEEN_S = 0.5, 0.2
_ENGINE = "PATCHNET"  # as `render_engine/engine.py` has it
_NO_MAP = (
    "Black is shown behind objects: Cycles cannot look at the world while a window renders, and does so afterwards: "
    "render again"
)
_waiting: list[str] = []  # names of scenes whose maps are to be made
_making: Steps[None] | None = None  # of the map that is being made


def world_key(seen: SeenWorld) -> str:
    """32 hex digits over a world and all that it refers to, with the values of its frame."""
    digest = Digest()
    digest.block(seen.world)
    return digest.hexdigest()


def kept_background(depsgraph: bpy.types.Depsgraph, camera: Camera, *, baked: bool) -> Background:
    """Background as `background` has it, for a thread that cannot bake: of the map that is kept, else a warning."""
    if depsgraph.scene.render.film_transparent:
        return Background(None)
    seen = seen_world(depsgraph, baked=baked)
    if seen.color is not None or seen.world is None:
        return Background(BLACK if seen.color is None else seen.color)
    kept = session_of(depsgraph.scene.original).world
    if kept is None or kept.map is None or kept.key != world_key(seen):
        ask_for_map(depsgraph.scene.original)
        return Background(BLACK, (_NO_MAP,))
    return Background(kept.map.look(pixel_directions(camera)))


def ask_for_map(scene: bpy.types.Scene) -> None:
    """Have the map of a scene's world made soon, where there is a window."""
    if bpy.app.background:
        return
    if scene.name not in _waiting:
        _waiting.append(scene.name)
    if not bpy.app.timers.is_registered(_make_maps):
        bpy.app.timers.register(_make_maps, first_interval=0.0)


def _make_maps() -> float | None:
    """Make a part of a map that waits, so that the window lives between two; again later while Blender renders."""
    global _making
    if job_is_running():
        return _AGAIN_S
    if _making is None:
        if not _waiting:
            return None
        scene = bpy.data.scenes.get(_waiting.pop())
        _making = keep_map(scene) if scene is not None else None
        return 0.0
    try:
        with in_window(True):
            next(_making)
    except (StopIteration, ReferenceError):  # another file may have been opened meanwhile
        _end_map()
    except BaseException:
        _end_map()
        raise
    return _BETWEEN_S


def _end_map() -> None:
    """Forget the map that is being made."""
    global _making
    if _making is not None:
        _making.close()
        _making = None


def keep_map(scene: bpy.types.Scene) -> Steps[None]:
    """Make the map of a scene's world, if there is none that shows it, and redraw the viewports."""
    layer = next((window.view_layer for window in bpy.context.window_manager.windows if window.scene == scene), None)
    depsgraph = (layer or scene.view_layers[0]).depsgraph
    if depsgraph is None:  # nothing has looked at the scene yet
        return
    seen = seen_world(depsgraph, baked=False)
    session, key = session_of(scene), world_key(seen)
    if seen.color is not None or seen.world is None or (session.world is not None and session.world.key == key):
        return
    try:
        session.world = KeyedMap(key, (yield from world_map(seen.world.original, seen.frame)))
    except PatchNetError as error:
        session.world = KeyedMap(key, None)
        event("warning", f"Black is shown behind objects: {error}", logging.WARNING)
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _after_step(scene: bpy.types.Scene, _result: object) -> None:
    if scene.render.engine == _ENGINE:
        ask_for_map(scene)


def register() -> None:
    """Make maps after each step of a job, where our engine renders: a render beside the window may come next."""
    listeners.append(_after_step)


def unregister() -> None:
    """End the timer."""
    listeners.remove(_after_step)
    _waiting.clear()
    _end_map()
    if bpy.app.timers.is_registered(_make_maps):
        bpy.app.timers.unregister(_make_maps)
