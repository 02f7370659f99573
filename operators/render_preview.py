# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that render one camera's preview, heatmap and refined picture, and compare all strategies on it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import error_text
from ..patchnet_addon.runtime.stage_clock import StageClock
from . import overlay
from .jobs.job_operator import CodesJob, tell_notes
from .properties.stages import properties_of
from .schema.values import CAMERAS, IMPORTANCE, VIEW
from .session import results
from .session.keep import keep
from .session.shown_view import attach_view_stats, comparison_of
from .settings.job_settings import JobSettings

if TYPE_CHECKING:
    from .computing.views import View


class PATCHNET_OT_render_preview(CodesJob, bpy.types.Operator):
    """Render preview, heatmap and refined picture of the first camera as Blender images"""

    bl_idname = "patchnet.render_preview"
    bl_label = "Render Preview"
    __annotations__ = properties_of(CAMERAS, VIEW, IMPORTANCE)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Trace, score, refine, show."""
        result = yield from look(context, settings)
        said = tell_notes(self, result.warnings)
        wanted, errors = settings.view, result.errors
        refined = f"{wanted.budget:.0%} of the active pixels" if wanted.spp is None else f"with {wanted.budget_text}"
        if errors is None:
            spent = result.report["refined"]["spent"]
            return f"{result.camera.name}: refined {refined}, {spent:.3g} samples a pixel{said}"
        before, after = map(error_text, errors)
        return f"{result.camera.name}: error x 10,000 {before}, {after} after refining {refined}{said}"


def look(context: bpy.types.Context, settings: JobSettings) -> Steps[View]:
    """Render the first camera's view of the scene's result, show its pictures, and keep its figures.

    Raises SettingError, SceneError.
    """
    from .pipeline.views import view, view_background
    from .scene.cameras import focus_warnings, octree_cameras
    from .scene.pixel_filter import pixel_filter_of

    before, coded = results.voxels_of(context.scene), results.codes_of(context.scene)
    wanted = settings.view
    camera = (yield from octree_cameras(context, coded.octree, wanted.cameras, wanted.size))[0]
    clock = StageClock()
    with clock.stage("views"), overlay.unfinished_pictures(context) as meanwhile:
        behind = yield from view_background(context, coded.octree, camera, settings)
        looking = view(
            coded,
            camera,
            wanted,
            before.scope,
            background=behind,
            pixel_filter=pixel_filter_of(context.scene),
            meanwhile=meanwhile,
        )
        result = yield from looking
    result = replace(result, warnings=(*focus_warnings(context.scene, [camera]), *result.warnings))
    notes = results.without_view(before).notes | {"view": result.warnings}
    before = replace(before, seconds=before.seconds | clock.seconds, notes=notes)
    yield from overlay.show(context, [result], settings.view)
    keep(context.scene, attach_view_stats(before, result, compared=wanted.reference), "view")
    return result


class PATCHNET_OT_compare(CodesJob, bpy.types.Operator):
    """Trace a reference for the first camera, and measure the error that each strategy leaves after the budget"""

    bl_idname = "patchnet.compare"
    bl_label = "Compare Strategies"
    __annotations__ = properties_of(CAMERAS, VIEW, IMPORTANCE)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Trace the view with all strategies and keep the table."""
        result = yield from look(context, settings.changed(reference=True))
        found = comparison_of(result)
        best = next(row for row in found.rows if row.name != "optimal")
        before, after = error_text(found.unrefined), error_text(best.error)
        said = tell_notes(self, result.warnings)
        return f"{found.view}: error x 10,000 {before}, best {best.title} with {after}{said}"
