# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that bakes the light of the scene into the voxels."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ..patchnet_addon.octree.grid import Grid
from ..patchnet_addon.runtime.errors import SceneError
from ..patchnet_addon.runtime.progress import Progress, Steps
from .jobs.polls import VoxelJob
from .jobs.tell import tell
from .pipeline.stages import build, lit
from .session import results
from .settings.job_settings import JobSettings
from .state.watch import read_state
from .ui.properties import LightProperties


class PATCHNET_OT_bake_light(LightProperties, VoxelJob, bpy.types.Operator):
    """Bake the light that falls on the surface into the voxels"""

    bl_idname = "patchnet.bake_light"
    bl_label = "Bake Light"

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Read the surface again, light it, and build the octree on the same grid."""
        from ..patchnet_addon.lightmap.page_cache import KeptPages
        from .scene import read_scene

        before = results.voxels_of(context.scene)
        yield Progress(0, 1, "Reading the scene")
        source, state = read_scene(context.evaluated_depsgraph_get(), before.scope), read_state(context.scene)
        _check_bounds(source.bounds_world, before.octree.grid)
        settings, grid = replace(settings, scope=before.scope), before.octree.grid
        seconds = {name: value for name, value in before.seconds.items() if name in ("depth", "voxelize")}
        with KeptPages() as kept, results.timed(seconds, "light"):
            shade, assumed = yield from lit(context, source, grid, before.layout, settings, kept)
            octree = yield from build(source, grid, shade, settings, settings.light, before.layout, state)
        made = results.SceneResult(
            octree,
            before.scope,
            before.layout,
            settings.light,
            seconds=seconds,
            made_with=before.made_with,
            state=state,
        )
        results.keep(context.scene, made, "light")
        for warning in assumed:
            tell(self, "WARNING", warning)
        return f"{octree.leaf_count:,} voxels are lit ({settings.light})"


def _check_bounds(bounds_world: np.ndarray, grid: Grid) -> None:
    """Raise SceneError if the surface (2, 3) has left the cube that was voxelized."""
    corners = grid.to_unit(bounds_world)
    if corners.min() < 0.0 or corners.max() > 1.0:
        raise SceneError("Objects have moved out of the voxels, or others are selected: run Voxelize again")


CLASSES = (PATCHNET_OT_bake_light,)
