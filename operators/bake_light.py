# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that bakes the light of the scene into the voxels."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted
from ..patchnet_addon.runtime.stage_clock import StageClock
from .jobs.polls import VoxelJob
from .jobs.tell import tell_notes
from .properties import LightProperties
from .session import results
from .session.scene_result import SceneResult
from .settings.job_settings import JobSettings


class PATCHNET_OT_bake_light(LightProperties, VoxelJob, bpy.types.Operator):
    """Bake the light that falls on the surface into the voxels"""

    bl_idname = "patchnet.bake_light"
    bl_label = "Bake Light"

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Build the octree on the same grid again, in light."""
        from ..patchnet_addon.lightmap.page_cache import BakePageCache
        from .pipeline.lit_octree import Recipe, build_lit_octree
        from .pipeline.stages import GridChoice

        before, self._goes_on = results.voxels_of(context.scene), settings.light.is_baked
        settings, clock = settings.changed(scope=before.scope), StageClock()
        chosen = None if before.state is None else before.state.chosen  # whatever is selected now, such as a lamp
        recipe = Recipe(grid=GridChoice(before.octree.grid, before.layout), chosen=chosen)
        with BakePageCache() as kept:
            made = yield from build_lit_octree(context, settings, clock, kept, recipe)
        seconds = {name: value for name, value in before.seconds.items() if name in ("depth", "voxelize")}
        seconds["light"] = sum(clock.seconds.get(name, 0.0) for name in ("light", "denoise", "voxelize"))
        result = SceneResult(
            made.octree,
            before.scope,
            before.layout,
            settings.light.kind,
            seconds=seconds,
            made_with=before.made_with,
            made_by=before.made_by,
            state=made.state,
            notes={"octree": made.warnings},
        )
        results.keep(context.scene, result, "light", settings=settings)
        said = tell_notes(self, made.warnings)
        return f"{counted(made.octree.leaf_count, 'voxel')} in light ({settings.light.kind}){said}"


CLASSES = (PATCHNET_OT_bake_light,)
