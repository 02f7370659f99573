# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory back to the machine."""

from __future__ import annotations

import bpy

from . import overlay, results
from .memory import give_back
from .polls import no_job_runs


class PATCHNET_OT_clear_results(bpy.types.Operator):
    """Free the memory that the octree and the codes of this scene take; what was shown and written stays"""

    bl_idname = "patchnet.clear_results"
    bl_label = "Free Memory"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be something to free, and nobody at work on it."""
        if results.result_of(context.scene) is None:
            cls.poll_message_set("There are no results to free")
            return False
        return no_job_runs(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Forget the scene's results."""
        results.forget(context.scene)
        overlay.forget(context)
        give_back()
        return {"FINISHED"}


CLASSES = (PATCHNET_OT_clear_results,)
