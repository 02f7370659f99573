# SPDX-License-Identifier: GPL-3.0-or-later
"""All strategies on one view, against each other and against the reference."""

from __future__ import annotations

import bpy

from ..patchnet_addon.progress import Steps
from . import results
from .job.settings import JobSettings
from .job_operator import JobOperator
from .properties import CameraProperties, ViewProperties
from .render_preview import look
from .seen import comparison_of


class PATCHNET_OT_compare(CameraProperties, ViewProperties, JobOperator, bpy.types.Operator):
    """Measure on the first camera what error every strategy leaves after the budget, beside the reference; the numbers
    stand in the panel, the pictures of the chosen strategy among Blender's images"""

    bl_idname = "patchnet.compare"
    bl_label = "Compare Strategies"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be codes."""
        result = results.result_of(context.scene)
        if result is None or result.coded is None:
            cls.poll_message_set(results.NO_CODES)
            return False
        return super().poll(context)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Trace the view with all strategies, keep the table."""
        found = comparison_of((yield from look(context, settings, compare=True)))
        best = next(row for row in found.rows if row.name != "optimal")
        return f"{found.view}: error {found.unrefined:.2e}, best {best.name} with {best.error:.2e}"


CLASSES = (PATCHNET_OT_compare,)
