# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that lights a fly-through once, and renders its frames with the render engine."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field

import bpy
from bpy.app.handlers import persistent

from ..patchnet_addon.runtime.progress import Progress, Steps
from ..patchnet_addon.runtime.quantities import counted
from .jobs.job_operator import JobOperator, job_in_window, tell, tell_notes
from .properties.job import wanted_frames
from .properties.stages import FrameProperties
from .scene_access.window_job import RENDER, job_is_running, window_is_alive
from .scene_access.window_state import Part
from .settings.job_settings import JobSettings

_POLL_S = 0.5


class PATCHNET_OT_fly_through(FrameProperties, JobOperator, bpy.types.Operator):
    """Light the scene once for all frames of a moving camera, and render those that are missing in the output folder"""

    bl_idname = "patchnet.fly_through"
    bl_label = "Bake Fly-Through"

    def steps(self, context: bpy.types.Context, _settings: JobSettings) -> Steps[str]:
        """Say what to expect, bake, and render the frames; in a window that is Blender's own render."""
        from .render_engine.fly_through import FlyThrough, bake_fly_through, render_fly_through

        self._goes_on = True
        frames = wanted_frames(context, self)

        def told(expected: FlyThrough) -> None:
            for line in expected.lines():
                tell(self, "INFO", line)

        baked = yield from bake_fly_through(context, frames, told)
        if baked.result is None:
            return f"All frames are in {baked.folder}"
        said, film = tell_notes(self, baked.result.all_notes), counted(len(baked.frames), "frame")
        if window_is_alive():
            _films().waiting.append((context.scene.session_uid, frames))
            if not bpy.app.timers.is_registered(_render_film):
                bpy.app.timers.register(_render_film, first_interval=_POLL_S)
            return f"Blender renders {film} into {baked.folder}{said}"
        yield Progress(0, 1, f"Rendering {film}")
        render_fly_through(context.scene, frames, baked)
        return f"{film} in {baked.folder}{said}"


@dataclass(eq=False)
class FilmsBesideWindow:
    """Films that Blender renders beside the window, one after the other.

    waiting: session_uid of each scene, and its frames. changed: settings of the present one's scene until it ends.
    """

    waiting: list[tuple[int, range]] = field(default_factory=list)
    changed: ExitStack = field(default_factory=ExitStack)


_films = Part("films", FilmsBesideWindow)


def _render_film() -> float | None:
    """Start Blender's render of a film once the operator has ended; the scene has its engine back after it."""
    from .render_engine.fly_through import frames_by_engine

    if job_is_running(RENDER):
        return _POLL_S
    unregister()
    films, scenes = _films(), {scene.session_uid: scene for scene in bpy.data.scenes}
    films.waiting = [(scene, frames) for scene, frames in films.waiting if scene in scenes]
    if not films.waiting:
        return None
    if job_in_window().title:
        return _POLL_S
    scene, frames = films.waiting.pop(0)
    films.changed.enter_context(frames_by_engine(scenes[scene], frames))
    try:
        bpy.ops.render.render("INVOKE_DEFAULT", animation=True, scene=scenes[scene].name)
    except RuntimeError:  # as where Blender cannot write the pictures
        unregister()
        raise
    return _POLL_S


@persistent
def unregister(*_: object) -> None:
    """Give a film's scene its settings back, also before another file opens."""
    _films().changed.close()


HANDLERS = (("load_pre", unregister),)
TIMERS = (_render_film,)
