# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that voxelizes objects to an octree of their own colour."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Steps
from ..patchnet_addon.runtime.quantities import counted
from ..patchnet_addon.runtime.stage_clock import StageClock
from .jobs.job_operator import JobOperator, tell_notes
from .properties.stages import properties_of
from .schema.values import CAMERAS, OCTREE
from .session.keep import keep
from .session.scene_result import SceneResult
from .settings.job_settings import JobSettings


class PATCHNET_OT_voxelize(JobOperator, bpy.types.Operator):
    """Turn the objects into a sparse voxel octree, with voxels as small as Voxel Detail says"""

    bl_idname = "patchnet.voxelize"
    bl_label = "Voxelize"
    __annotations__ = properties_of(OCTREE, CAMERAS)

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Build and keep the octree in the surface's own colour."""
        from .pipeline.lit_octree import OctreeOverrides, build_lit_octree, cameras_key

        clock = StageClock()
        made = yield from build_lit_octree(context, settings, clock, overrides=OctreeOverrides(unlit=True))
        seconds = {name: clock.seconds[name] for name in ("depth", "voxelize")}
        octree = made.octree
        result = SceneResult(octree, settings.surface.scope, made.layout, seconds=seconds, state=made.state)
        result.made_by, result.notes = {"cameras": cameras_key(context, settings)}, {"octree": made.warnings}
        keep(context.scene, result, "octree", settings=settings)
        side = f"side {octree.grid.voxel_size_world:.4g}" + (" and more" if made.layout else "")
        said = tell_notes(self, made.warnings)
        return f"{counted(octree.leaf_count, 'voxel')} of {side}, depth {octree.depth}{said}"
