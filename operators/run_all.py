# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that runs the whole job in one step."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted, error_text
from . import overlay
from .jobs.job_operator import JobOperator
from .jobs.tell import tell
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

        self._file = settings.out
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
        for warning in result.warnings:
            tell(self, "WARNING", warning)
        errors = "" if first.errors is None else "; {}: error x 10,000 {} -> {}".format(
            first.camera.name, *map(error_text, first.errors)
        )
        where = f", files in {settings.out}" if settings.out else ""
        return f"{counted(len(result.views), 'view')}{errors}{where}"


CLASSES = (PATCHNET_OT_run_all,)
