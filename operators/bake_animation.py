# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that bakes all frames of the scene, each with its own octree and pictures."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.errors import SettingError
from ..patchnet_addon.runtime.progress import Steps
from .jobs.job_operator import JobOperator, tell
from .properties.job import setting, wanted_frames
from .properties.stages import AnimationProperties, FrameProperties, properties_of
from .schema.values import JOB
from .settings.job_settings import JobSettings


class PATCHNET_OT_bake_animation(FrameProperties, AnimationProperties, JobOperator, bpy.types.Operator):
    """Run all steps for every frame, each into a folder of its own in the output folder"""

    bl_idname = "patchnet.bake_animation"
    bl_label = "Bake Animation"
    __annotations__ = properties_of(*JOB)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require that nothing else may change the frame."""
        if context.screen is not None and context.screen.is_animation_playing:
            cls.poll_message_set("The animation is playing: stop it first")
            return False
        return super().poll(context)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Bake the frames that are not there."""
        from .animation.animation import FramePlan, bake_frames
        from .animation.frame_maker import JobMaker

        if settings.out is None:
            raise SettingError("An animation needs a folder for its frames: choose the output folder")
        self._file, self._goes_on = settings.out, setting(context, self, "skip_existing")
        plan = FramePlan(
            frames=tuple(wanted_frames(context, self)),
            out=settings.out,
            overwrite=not setting(context, self, "skip_existing"),
            one_grid=setting(context, self, "same_grid"),
        )
        result = yield from bake_frames(context, JobMaker(settings), plan)
        for warning in result.warnings:
            tell(self, "WARNING", warning)
        return f"{result.sentence()}, files in {settings.out}"
