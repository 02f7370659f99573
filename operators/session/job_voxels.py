# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxels that a job finds instead of making them: those of the scene, or of the cache folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ...patchnet_addon.runtime.quantities import counted
from ..schema.values import CODES, LIGHT, OCTREE, SELECTED
from ..settings.job_settings import JobSettings
from . import results
from .octree_cache import found_on_disk, may_be_on_disk
from .scene_result import VOXELS, SceneResult
from .staleness import look_again

if TYPE_CHECKING:
    from ..pipeline.run import Before, JobResult

STAGES = OCTREE, LIGHT, CODES


def key_of_job(context: bpy.types.Context, settings: JobSettings) -> str:
    """`voxels_key` of a job at the scene's present frame. Raises as `read_scene` and `choose_cameras` do."""
    from ..pipeline.lit_octree import cameras_key
    from ..pipeline.voxels_key import surface_key, voxels_key

    graph = context.evaluated_depsgraph_get()
    return voxels_key(graph, settings, surface_key(graph, settings), cameras_key(context, settings))


def voxels_before(context: bpy.types.Context, settings: JobSettings, key: str = "") -> Before | None:
    """Voxels whose grid a job can reuse, with their light and codes if they fit; None if voxels have to be made.

    key: `key_of_job`, under which the cache folder is searched last; without it only if there is no such grid.
    """
    scene = context.scene
    result = _checked(results.result_of(scene), scene)
    if result is None or result.stale:  # an earlier state of the scene may be back
        result = _checked(found_on_disk(scene, network=settings.network), scene) or result
    before = None if result is None else _reusable(context, settings, result)
    if before is not None and (before.lit or not key):
        return before
    if not (key or may_be_on_disk(scene)):
        return before
    return before_on_disk(context, settings, key or key_of_job(context, settings)) or before


def before_on_disk(context: bpy.types.Context, settings: JobSettings, key: str) -> Before | None:
    """Finished voxels in the cache folder, by their `key_of_job`."""
    found = found_on_disk(context.scene, key, settings.network)
    return None if found is None else _before(found, lit=True, same_view=True)


def before_again(result: JobResult) -> Before:
    """Voxels of a finished job for another one."""
    from ..pipeline.run import Before

    coded, encoder = result.coded, result.report["encoder"]
    return Before(coded.octree, result.layout, result.state, True, True, coded, encoder, result.notes["octree"])


def result_of_job(context: bpy.types.Context, settings: JobSettings, result: JobResult, key: str = "") -> SceneResult:
    """What the scene keeps of a job's result. key: `key_of_job`."""
    from ..pipeline.lit_octree import cameras_key, cameras_text
    from ..scene.track import track_key

    made_by = {stage: settings.key(stage) for stage in STAGES} | {
        "cameras": cameras_key(context, settings),
        "seen": cameras_text([view.camera for view in result.views]),
        "track": track_key(context.scene, settings.surface.fitted_track),
        VOXELS: key,
    }
    return SceneResult(
        octree=result.coded.octree,
        scope=settings.surface.scope,
        layout=result.layout,
        light=settings.light.kind,
        coded=result.coded,
        encoder=result.report["encoder"],
        made_by=made_by,
        state=result.state,
        notes=result.notes,
    )


def other_objects(context: bpy.types.Context, result: SceneResult) -> str:
    """Sentence if selection and voxels differ, else ""; selected objects without a surface do not count."""
    from ..state.scene_state import with_surface

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


def _reusable(context: bpy.types.Context, settings: JobSettings, result: SceneResult) -> Before | None:
    """Part of a result that fits the settings."""
    from ..pipeline.lit_octree import cameras_key

    others = settings.surface.scope == SELECTED and other_objects(context, result)
    if others or "surface" in result.stale or result.made_by.get(OCTREE) != settings.key(OCTREE):
        return None
    moved = result.made_by.get("cameras") != cameras_key(context, settings)
    if settings.surface.is_fitted and moved:
        return None
    lit = not moved and result.light == settings.light.kind and result.made_by.get(LIGHT) == settings.key(LIGHT)
    lit = lit and "light" not in result.stale and not result.unfinished
    return _before(result, lit=lit, same_view=not moved, coded=result.made_by.get(CODES) == settings.key(CODES))


def _before(result: SceneResult, *, lit: bool, same_view: bool, coded: bool = True) -> Before:
    from ..pipeline.run import Before

    codes, warnings = result.coded if coded else None, result.notes.get("octree", ())
    return Before(result.octree, result.layout, result.state, lit, same_view, codes, result.encoder, warnings)
