# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that voxelizes objects to an octree that shows their own colour."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.progress import Progress, Steps
from .jobs.job_operator import JobOperator
from .jobs.tell import tell
from .pipeline.stages import UNLIT, build, choose_grid, unlit
from .scene.cameras import choose_cameras, track_cameras
from .session import results
from .settings.job_settings import JobSettings
from .state.watch import read_state
from .ui.properties import CameraProperties, VoxelizeProperties


class PATCHNET_OT_voxelize(VoxelizeProperties, CameraProperties, JobOperator, bpy.types.Operator):
    """Turn objects into a sparse voxel octree, as finely as the cameras need it"""

    bl_idname = "patchnet.voxelize"
    bl_label = "Voxelize"

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Read the surface, choose the grid, build the octree, keep it."""
        from .scene import read_scene

        yield Progress(0, 1, "Reading the scene")
        source, state = read_scene(context.evaluated_depsgraph_get(), settings.scope), read_state(context.scene)
        depsgraph = context.evaluated_depsgraph_get()
        fixed = settings.depth or settings.voxel_world
        names, size, bounds = settings.cameras, settings.size, source.bounds_world
        if settings.track:
            cameras = track_cameras(context, names, size, bounds)
        else:
            cameras = [] if fixed else choose_cameras(depsgraph, names, size, bounds)
        seconds: dict[str, float] = {}
        with results.timed(seconds, "depth"):
            choice = yield from choose_grid(source, cameras, settings)
        with results.timed(seconds, "voxelize"):
            shade = yield from unlit(source, settings)
            octree = yield from build(source, choice.grid, shade, settings, UNLIT, choice.layout, state)
        made = results.SceneResult(octree, settings.scope, choice.layout, seconds=seconds, state=state)
        results.keep(context.scene, made, "octree")
        for warning in (*source.warnings, *choice.warnings):
            tell(self, "WARNING", warning)
        side = f"side {octree.grid.voxel_world:.4g}" + (" and more" if choice.layout else "")
        return f"{octree.leaf_count:,} voxels of {side}, depth {octree.depth}"


CLASSES = (PATCHNET_OT_voxelize,)
