# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that runs the whole job in one step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

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
    from .pipeline.run import Before


class PATCHNET_OT_run_all(JobOperator, bpy.types.Operator):
    """Voxelize objects, bake light, and render preview, heatmap and refined picture; up-to-date steps are skipped"""

    bl_idname = "patchnet.run_all"
    bl_label = "Preview Selection"
    __annotations__ = properties_of(*JOB)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Run stale steps of the job, keep the results, show the first camera's pictures."""
        from .pipeline.lit_octree import cameras_key
        from .pipeline.run import run_job

        self._file, self._goes_on, scene = settings.out, settings.light.is_baked, context.scene
        there = results.result_of(scene)
        replaced = _other_objects(context, there) if there and settings.surface.scope == SELECTED else ""
        before = _before(context, settings)
        with overlay.unfinished_pictures(context) as meanwhile:
            result = yield from run_job(context, settings, meanwhile, before)
        first, steps = result.views[0], ["view"]
        made = results.result_of(scene)
        if made is None or made.coded is not result.coded:
            steps += ["octree", "light", "codes"]
            made = SceneResult(
                octree=result.coded.octree,
                scope=settings.surface.scope,
                layout=result.layout,
                light=settings.light.kind,
                coded=result.coded,
                encoder=result.report["encoder"],
                made_by={"cameras": cameras_key(context, settings)},
                state=result.state,
            )
        made = attach_view_stats(made, first, compared=settings.view.reference)
        made.seconds = made.seconds | result.report["timings_s"]
        made.notes = result.notes | ({"objects": (replaced,)} if replaced else {})
        results.keep(scene, made, *steps, settings=settings)
        overlay.show(context, result.views, settings.view)
        errors = (
            ""
            if first.errors is None
            else "; {}: error x 10,000 {} -> {}".format(first.camera.name, *map(error_text, first.errors))
        )
        where = f", files in {settings.out}" if settings.out else ""
        return f"{counted(len(result.views), 'view')}{errors}{where}{tell_notes(self, made.all_notes)}"


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
    if settings.surface.track or result.made_by.get("cameras") != cameras_key(context, settings):
        return None
    lit = result.light == settings.light.kind and result.made_by.get("light") == settings.key("light")
    lit = lit and "light" not in result.stale
    coded = result.coded if result.made_by.get("codes") == settings.key("codes") else None
    warnings = result.notes.get("octree", ())
    return Before(result.octree, result.layout, result.state, lit, coded, result.encoder, warnings)
