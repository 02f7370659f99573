# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that compares all strategies on one view, with each other and with the reference."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import error_text
from .jobs.polls import CodesJob
from .jobs.tell import tell_notes
from .properties import CameraProperties, ViewProperties
from .render_preview import look
from .session.shown_view import comparison_of
from .settings.job_settings import JobSettings


class PATCHNET_OT_compare(CameraProperties, ViewProperties, CodesJob, bpy.types.Operator):
    """Trace a reference for the first camera, and measure the error that each strategy leaves after the budget"""

    bl_idname = "patchnet.compare"
    bl_label = "Compare Strategies"

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Trace the view with all strategies and keep the table."""
        result = yield from look(context, settings, compare=True)
        found = comparison_of(result)
        best = next(row for row in found.rows if row.name != "optimal")
        before, after = error_text(found.unrefined), error_text(best.error)
        said = tell_notes(self, result.warnings)
        return f"{found.view}: error x 10,000 {before}, best {best.title} with {after}{said}"
