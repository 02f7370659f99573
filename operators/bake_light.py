# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that bakes the light of the scene into the voxels."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted
from .jobs.job_operator import VoxelJob, tell_notes
from .properties.stages import properties_of
from .schema.values import LIGHT
from .session import results
from .session.keep import keep
from .session.scene_result import SceneResult
from .settings.job_settings import JobSettings


class PATCHNET_OT_bake_light(VoxelJob, bpy.types.Operator):
    """Bake the light that falls on the surface into the voxels"""

    bl_idname = "patchnet.bake_light"
    bl_label = "Bake Light"
    __annotations__ = properties_of(LIGHT)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Build the octree on the same grid again, with baked light."""
        from .pipeline.job_work import JobPlan
        from .pipeline.lit_octree import OctreeOverrides, cameras_text, choose_leaves, light_octree, read_surface

        before, self._goes_on = results.voxels_of(context.scene), settings.light.is_baked
        settings = settings.changed(scope=before.scope)
        plan, overrides = JobPlan(settings), OctreeOverrides.on_grid_of(before.octree, before.layout, before.state)
        clock = plan.clock
        surface = yield from read_surface(context, settings, clock, overrides)
        choice = yield from choose_leaves(context, surface, clock)
        plan.make(surface.source, choice, choice.cameras, "light", "voxelize")
        made = yield from plan.timed(light_octree(context, surface, choice, clock))
        plan.resumed, plan.layers = made.reused > 0.0, made.layers
        plan.learn()
        seconds = {name: value for name, value in before.seconds.items() if name in ("depth", "voxelize")}
        seconds["light"] = sum(clock.seconds.get(name, 0.0) for name in ("light", "voxelize"))
        result = SceneResult(made.octree, before.scope, before.layout, settings.light.kind, seconds=seconds)
        result.made_with, result.state = before.made_with, made.state
        result.made_by = before.made_by | {"seen": cameras_text(choice.cameras)}
        result.notes = {"octree": made.warnings}
        keep(context.scene, result, "light", settings=settings)
        said = tell_notes(self, made.warnings)
        return f"{counted(made.octree.leaf_count, 'voxel')} in light ({settings.light.kind}){said}"
