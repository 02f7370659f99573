# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that estimates the depth, memory and files of Preview Selection, before it runs."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Steps
from .jobs.job_operator import JobOperator, tell, tell_notes
from .properties.stages import properties_of
from .session.scene_session import session_of
from .settings.job_settings import ESTIMATED, JobSettings, recorded


class PATCHNET_OT_estimate(JobOperator, bpy.types.Operator):
    """Estimate depth, time, memory, and the share of pixels with look-ahead, without making voxels"""

    bl_idname = "patchnet.estimate"
    bl_label = "Estimate"
    __annotations__ = properties_of(*ESTIMATED)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Estimate the job and keep the estimate for the panel."""
        from .pipeline.estimate import estimate_job

        found = yield from estimate_job(context, settings)
        found.settings = recorded(context.scene.patchnet, *ESTIMATED)
        session_of(context.scene).estimate = found
        if found.too_large:
            tell(self, "WARNING", "The octree would not fit into memory: choose a smaller depth or fewer objects")
        return ", ".join(found.lines[:3]) + tell_notes(self, found.notes, below="Estimate")
