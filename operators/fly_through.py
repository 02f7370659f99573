# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that lights a fly-through once, and renders its frames with the render engine."""

from __future__ import annotations

from contextlib import ExitStack

import bpy

from ..patchnet_addon.runtime.frames import frame_range
from ..patchnet_addon.runtime.progress import Progress, Steps
from ..patchnet_addon.runtime.quantities import counted
from .jobs.job_operator import JobOperator, tell, tell_notes
from .properties.job import is_given
from .properties.stages import FrameProperties
from .scene_access.window_job import RENDER, job_is_running, window_is_alive
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
        names = ("frame_start", "frame_end", "frame_step")
        frames = frame_range(*(int(getattr(self if is_given(self, name) else context.scene, name)) for name in names))

        def told(expected: FlyThrough) -> None:
            for line in expected.lines():
                tell(self, "INFO", line)

        baked = yield from bake_fly_through(context, frames, told)
        if baked.result is None:
            return f"All frames are in {baked.folder}"
        said, film = tell_notes(self, baked.result.all_notes), counted(len(baked.frames), "frame")
        if window_is_alive():
            uid = context.scene.session_uid
            bpy.app.timers.register(lambda: _render_beside(uid, frames), first_interval=_POLL_S)
            return f"Blender renders {film} into {baked.folder}{said}"
        yield Progress(0, 1, f"Rendering {film}")
        render_fly_through(context.scene, frames, baked)
        return f"{film} in {baked.folder}{said}"


def _render_beside(uid: int, frames: range) -> float | None:
    """Start Blender's render of the frames once the operator has ended; the scene has its engine back after it."""
    from .render_engine.fly_through import frames_by_engine

    scene = next((item for item in bpy.data.scenes if item.session_uid == uid), None)
    if scene is None:
        return None
    if JobOperator.running or job_is_running(RENDER):
        return _POLL_S
    stack = ExitStack()
    stack.enter_context(frames_by_engine(scene, frames))
    bpy.ops.render.render("INVOKE_DEFAULT", animation=True, scene=scene.name)

    def end() -> float | None:
        if job_is_running(RENDER):
            return _POLL_S
        stack.close()
        return None

    bpy.app.timers.register(end, first_interval=_POLL_S)
    return None
