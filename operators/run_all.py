# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that runs the whole job in one step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..patchnet_addon.export.fine_light import noise_text
from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted, error_text
from . import overlay
from .jobs.job_operator import JobOperator, tell_notes
from .properties.stages import JOB, properties_of
from .schema.table import SELECTED
from .session import octree_cache, results
from .session.scene_result import SceneResult
from .session.shown_view import attach_view_stats
from .session.staleness import look_again
from .settings.job_settings import JobSettings

if TYPE_CHECKING:
    from .pipeline.run import Before, JobResult


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
        from .pipeline.run import run_job
        from .pipeline.unfinished import Unfinished

        self._file, self._goes_on, self._noise, scene = settings.out, settings.light.is_baked, "", context.scene
        there = results.result_of(scene)
        replaced = _other_objects(context, there) if there and settings.surface.scope == SELECTED else ""
        before = _before(context, settings)
        with overlay.unfinished_pictures(context) as meanwhile:

            def early(result: JobResult) -> None:
                _keep(context, settings.changed(reference=False), result, replaced, unfinished=True)
                self._noise, first = noise_text(result.coded.octree), result.views[0]
                if meanwhile is not None:
                    title = f"refining light, noise {self._noise}"
                    meanwhile(Unfinished(first.camera.name, title, opaque(first.pictures["refined"])))

            looks = JobOperator.in_window is self
            result = yield from run_job(context, settings, meanwhile, before, early if looks else None)
        made, first = _keep(context, settings, result, replaced), result.views[0]
        errors = (
            ""
            if first.errors is None
            else "; {}: error x 10,000 {} -> {}".format(first.camera.name, *map(error_text, first.errors))
        )
        where = f", files in {settings.out}" if settings.out else ""
        return f"{counted(len(result.views), 'view')}{errors}{where}{tell_notes(self, made.all_notes)}"

    def _stopped(self, *, alive: bool = False) -> str:
        if self._noise:
            return f"Stopped. The pictures have light of noise {self._noise}: press again to refine it."
        return super()._stopped(alive=alive)


def _keep(
    context: bpy.types.Context, settings: JobSettings, result: JobResult, replaced: str, *, unfinished: bool = False
) -> SceneResult:
    """Keep a job's result for the scene, and show its pictures.

    replaced: sentence about other objects than before, or "". unfinished: the light is still being refined.
    """
    from .pipeline.lit_octree import cameras_key, cameras_text

    made, steps = results.result_of(context.scene), ["view"]
    if made is None or made.coded is not result.coded:
        steps += ["octree", "light", "codes"]
        seen = cameras_text([view.camera for view in result.views])
        made = SceneResult(
            octree=result.coded.octree,
            scope=settings.surface.scope,
            layout=result.layout,
            light=settings.light.kind,
            unfinished=unfinished,
            coded=result.coded,
            encoder=result.report["encoder"],
            made_by={"cameras": cameras_key(context, settings), "seen": seen},
            state=result.state,
        )
    made = attach_view_stats(made, result.views[0], compared=settings.view.reference)
    made.seconds = made.seconds | result.report["timings_s"]
    made.notes = result.notes | ({"objects": (replaced,)} if replaced else {})
    results.keep(context.scene, made, *steps, settings=settings)
    overlay.show(context, result.views, settings.view)
    return made


def _other_objects(context: bpy.types.Context, result: SceneResult) -> str:
    """Sentence if selection and voxels differ, else ""; selected objects without a surface do not count."""
    from .state.scene_state import with_surface

    if result.state is None:
        return ""
    selected = with_surface(context.scene, frozenset(item.session_uid for item in context.selected_objects))
    before = with_surface(context.scene, result.state.chosen)
    if not selected or selected == before:
        return ""
    count = counted(len(selected), "selected object")
    return f"The voxels are of {count} now, of {len(before)} before: choose Objects: Visible for all"


def _checked(result: SceneResult | None, scene: bpy.types.Scene) -> SceneResult | None:
    """Compare a result with the scene; None if its scene is unknown."""
    if result is None or result.state is None:
        return None
    look_again(result, scene)
    return result


def _before(context: bpy.types.Context, settings: JobSettings) -> Before | None:
    """Reusable part of the result; None if voxels have to be made."""
    from .pipeline.lit_octree import cameras_key
    from .pipeline.run import Before

    scene = context.scene
    result = _checked(results.result_of(scene), scene)
    if result is None or result.stale:  # an earlier state of the scene may be back
        result = _checked(octree_cache.found_on_disk(scene), scene) or result
    if result is None:
        return None
    others = settings.surface.scope == SELECTED and _other_objects(context, result)
    if others or "surface" in result.stale or result.made_by.get("octree") != settings.key("octree"):
        return None
    moved = result.made_by.get("cameras") != cameras_key(context, settings)
    if settings.surface.is_fitted and moved:
        return None
    lit = not moved and result.light == settings.light.kind and result.made_by.get("light") == settings.key("light")
    lit = lit and "light" not in result.stale and not result.unfinished
    coded = result.coded if result.made_by.get("codes") == settings.key("codes") else None
    warnings = result.notes.get("octree", ())
    return Before(result.octree, result.layout, result.state, lit, not moved, coded, result.encoder, warnings)
