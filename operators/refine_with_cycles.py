# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that renders the preview's worst pixels with Cycles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..patchnet_addon.runtime.eta import JobEta
from ..patchnet_addon.runtime.progress import Steps, changed
from ..patchnet_addon.runtime.quantities import error_text
from . import overlay
from .jobs.job_operator import CodesJob, tell_notes
from .properties.job import cycles_settings
from .properties.stages import properties_of
from .render_preview import look
from .schema.values import CAMERAS, IMPORTANCE, REFINEMENT, SELECTED, VIEW
from .session import results
from .session.scene_result import SceneResult
from .session.shown_view import CYCLES_PICTURE
from .settings.job_settings import JobSettings

if TYPE_CHECKING:
    from .computing.cycles_pixels import CyclesView


_ALL = "Cycles renders all objects, but the voxels are those of the selected ones: choose Objects: Visible for all"
_READING_S = 5.0  # estimate of the time that Cycles reads a small scene


class PATCHNET_OT_refine_with_cycles(CodesJob, bpy.types.Operator):
    """Let Cycles render the pixels of highest priority in the preview of the first camera"""

    bl_idname = "patchnet.refine_with_cycles"
    bl_label = "Refine with Cycles"
    __annotations__ = properties_of(CAMERAS, VIEW, IMPORTANCE, REFINEMENT)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Trace, score, choose pixels, render them, show."""
        from .pipeline.cycles_pictures import show_cycles
        from .pipeline.cycles_refine import check_light, refine_view
        from .pipeline.job_work import Rates, work_of
        from .scene.cameras import camera_size_px

        wanted = cycles_settings(context, self)
        check_light(results.codes_of(context.scene).octree)
        width, height = camera_size_px(context.scene, settings.view.size)
        work = work_of(settings.changed(cycles=wanted), pixels=width * height)
        eta, seconds = JobEta(), Rates().seconds({name: work[name] for name in ("views", "cycles")})
        eta.expect(seconds | {"cycles": seconds["cycles"] + _READING_S})
        seen = yield from changed(look(context, settings), lambda report: eta.see("views", report))
        refining = refine_view(context, seen, wanted, sun=settings.light.daylight)
        view = yield from changed(refining, lambda report: eta.see("cycles", report))
        overlay.add(context, view.camera.name, CYCLES_PICTURE, *show_cycles(view))
        result = results.voxels_of(context.scene)
        notes = view.warnings + ((_ALL,) if _leaves_out(context.scene, result) else ())
        result.notes["cycles"] = notes
        return f"{summary(view)}{tell_notes(self, notes)}"


def _leaves_out(scene: bpy.types.Scene, result: SceneResult) -> bool:
    """Return whether objects with a surface have no voxels, because they were not selected."""
    from .state.scene_state import with_surface

    chosen = None if result.state is None else result.state.chosen
    return result.scope == SELECTED and with_surface(scene, chosen) != with_surface(scene, None)


def summary(view: CyclesView) -> str:
    """Sentence with the figures of a view."""
    report = view.report
    seconds = report["seconds"]
    text = (
        f"{view.camera.name}: Cycles rendered {report['pixels_share']:.1%} of the pixels "
        f"with {report['priority_share']:.0%} of the priority, {seconds['pixels']:.1f} s"
    )
    if view.full is None:
        return text
    mse = {name: error_text(value) for name, value in report["mse"].items()}
    errors = f"error x 10,000 {mse[report['unrefined']]} -> {mse['composited']}, of the full render {mse['full']}"
    return f"{text}, all of them {seconds['full']:.1f} s; {errors}"
