# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that runs the whole job in one step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..patchnet_addon.export.fine_light import noise_text
from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted, error_text
from . import overlay
from .jobs.job_operator import JobOperator, job_in_window, tell_notes
from .properties.stages import properties_of
from .schema.values import JOB, SELECTED
from .session import results
from .session.job_voxels import STAGES, other_objects, result_of_job, voxels_before
from .session.keep import keep
from .session.scene_result import SceneResult
from .session.shown_view import attach_view_stats
from .settings.job_settings import JobSettings

if TYPE_CHECKING:
    from .pipeline.run import JobResult


class PATCHNET_OT_run_all(JobOperator, bpy.types.Operator):
    """Voxelize objects, bake light, and render preview, heatmap and refined picture; up-to-date steps are skipped"""

    bl_idname = "patchnet.run_all"
    bl_label = "Preview Selection"
    __annotations__ = properties_of(*JOB)
    _noise = ""  # of the pictures that are shown while light is refined

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Run stale steps of the job, keep the results, show the first camera's pictures.

        In a window, also after each round of the light: that of the last one stays if the steps are closed.
        """
        from ..patchnet_addon.image.background import opaque
        from ..patchnet_addon.image.unfinished import Unfinished
        from .pipeline.run import run_job
        from .pipeline.voxels_key import hashed_code

        self._file, self._goes_on, self._noise, scene = settings.out, settings.light.is_baked, "", context.scene
        there = results.result_of(scene)
        replaced = other_objects(context, there) if there and settings.surface.scope == SELECTED else ""
        yield from hashed_code()
        before = voxels_before(context, settings)
        with overlay.unfinished_pictures(context) as meanwhile:

            def early(result: JobResult) -> Steps[None]:
                yield from _keep(context, settings.changed(reference=False), result, replaced, unfinished=True)
                self._noise, first = noise_text(result.coded.octree), result.views[0]
                if meanwhile is not None:
                    title = f"refining light, noise {self._noise}"
                    meanwhile(Unfinished(first.camera.name, title, opaque(first.pictures["refined"])))

            looks = job_in_window().operator is self
            result = yield from run_job(context, settings, meanwhile, before, early if looks else None)
        made, first = (yield from _keep(context, settings, result, replaced)), result.views[0]
        errors = (
            ""
            if first.errors is None
            else "; {}: error x 10,000 {} -> {}".format(first.camera.name, *map(error_text, first.errors))
        )
        where = f", files in {settings.out}" if settings.out else ""
        return f"{counted(len(result.views), 'view')}{errors}{where}{tell_notes(self, made.all_notes)}"

    def _stopped(self) -> str:
        if self._noise:
            return f"Stopped. The pictures have light of noise {self._noise}: press again to refine it."
        return super()._stopped()


def _keep(
    context: bpy.types.Context, settings: JobSettings, result: JobResult, replaced: str, *, unfinished: bool = False
) -> Steps[SceneResult]:
    """Keep a job's result for the scene, and show its pictures.

    replaced: sentence about other objects than before, or "". unfinished: the light is still being refined.
    """
    yield from overlay.show(context, result.views, settings.view)
    made, steps = results.result_of(context.scene), ["view"]
    if made is None or made.coded is not result.coded:
        steps += STAGES
        made = result_of_job(context, settings, result)
        made.unfinished = unfinished
    made = attach_view_stats(made, result.views[0], compared=settings.view.reference)
    made.seconds = made.seconds | result.report["timings_s"]
    made.notes = result.notes | ({"objects": (replaced,)} if replaced else {})
    keep(context.scene, made, *steps, settings=settings)
    return made
