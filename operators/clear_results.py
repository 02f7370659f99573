# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that frees the memory of a scene's octree and codes."""

from __future__ import annotations

import bpy

from ..patchnet_addon.process.computed import end_engine_process
from . import overlay
from .jobs.job_operator import no_job_runs
from .scene_access.images import free_copies
from .scene_access.own import is_own
from .session import results
from .session.scene_session import give_back

_DRAWN_AGAIN_S = 0.5


class PATCHNET_OT_clear_results(bpy.types.Operator):
    """Free the memory of this scene's octree and look-ahead; images and files stay"""

    bl_idname = "patchnet.clear_results"
    bl_label = "Free Memory"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require results, and no job."""
        if results.result_of(context.scene) is None:
            cls.poll_message_set("There are no results to free")
            return False
        return no_job_runs(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Forget the scene's results."""
        results.forget(context.scene)
        overlay.forget(context)
        for image in filter(is_own, bpy.data.images):
            free_copies(image)
        give_back()
        end_engine_process()
        if not bpy.app.background:  # viewports free their pictures at the next redraw
            bpy.app.timers.register(give_back, first_interval=_DRAWN_AGAIN_S)
        return {"FINISHED"}


TIMERS = (give_back,)
