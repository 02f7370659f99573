# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that runs the whole job in one step."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.wording import counted
from . import overlay
from .jobs.job_operator import JobOperator
from .jobs.tell import tell_notes
from .session import results
from .session.scene_result import SceneResult
from .session.seen import seen
from .settings.job_settings import JobSettings
from .ui.properties import JobProperties


class PATCHNET_OT_run_all(
    JobProperties,
    JobOperator,
    bpy.types.Operator,
):
    """Voxelize, bake, look ahead, and refine the view of the camera where its preview is wrong"""

    bl_idname = "patchnet.run_all"
    bl_label = "Preview Selection"

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Run the job, keep its results, show the first camera's pictures."""
        from .pipeline.run import run_job

        self._file, self._goes_on = settings.out, settings.light.is_baked
        with overlay.unfinished_pictures(context) as meanwhile:
            result = yield from run_job(context, settings, meanwhile)
        first = result.views[0]
        results.keep(
            context.scene,
            seen(
                SceneResult(
                    octree=result.coded.octree,
                    scope=settings.surface.scope,
                    layout=result.layout,
                    light=settings.light.kind,
                    coded=result.coded,
                    seconds=result.report["timings_s"],
                    encoder=result.report["encoder"],
                    state=result.state,
                    notes=result.notes,
                ),
                first,
                compared=settings.view.reference,
            ),
            "octree",
            "light",
            "codes",
            "view",
        )
        overlay.show(context, result.views, settings.view)
        errors = "" if first.errors is None else "; {}: error {:.2e} -> {:.2e}".format(first.camera.name, *first.errors)
        where = f", files in {settings.out}" if settings.out else ""
        return f"{counted(len(result.views), 'view')}{errors}{where}{tell_notes(self, result.warnings)}"


CLASSES = (PATCHNET_OT_run_all,)
