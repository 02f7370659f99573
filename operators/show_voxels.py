# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that shows one level of the octree as an object of the scene."""

from __future__ import annotations

import bpy

from ..patchnet_addon.runtime.errors import PatchNetError
from .jobs.job_operator import has_voxels, in_object_mode, no_job_runs, tell, tell_start
from .properties.job import setting
from .properties.preferences import apply_preferences
from .properties.stages import DisplayProperties
from .scene_access.own import quiet
from .session import results
from .voxel_object import show


class PATCHNET_OT_show_voxels(DisplayProperties, bpy.types.Operator):
    """Add the voxels of one level to the scene, in the color of their light; renders and Voxelize ignore them"""

    bl_idname = "patchnet.show_voxels"
    bl_label = "Show Voxels"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require voxels that no job works on, and a mode in which objects can be added."""
        return has_voxels(cls, context) and in_object_mode(cls, context, "Voxels can be shown") and no_job_runs(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Choose the level, create or update the object, and report it."""
        from ..patchnet_addon.octree.voxel_cloud import level_within, voxel_cloud, voxel_counts

        for name in ("level", "limit"):  # so that Adjust Last Operation starts with the values in use
            setattr(self, name, setting(context, self, name))
        try:
            apply_preferences(context)
            tell_start(self)
            octree = results.voxels_of(context.scene).octree
            wanted = self.level or octree.depth
            level = level_within(octree, self.limit, wanted)
            with quiet():
                item = show(context.scene, voxel_cloud(octree, level))
            _show_attribute_colors(context.window)
        except PatchNetError as error:
            tell(self, "ERROR", str(error))
            return {"CANCELLED"}
        counts = voxel_counts(octree)
        shown = f"{counts[level]:,} voxels of level {level} in '{item.name}'"
        if level < wanted:
            shown = f"{shown}: level {wanted} has {counts[wanted]:,}, more than the limit of {self.limit:,}"
        tell(self, "WARNING" if level < wanted and self.level else "INFO", shown)
        return {"FINISHED"}


def _show_attribute_colors(window: bpy.types.Window | None) -> None:
    """Set viewports in Solid shading to the colors of attributes, which voxels have, as vertex painting does."""
    for area in window.screen.areas if window is not None else ():
        if area.type == "VIEW_3D" and area.spaces.active.shading.type == "SOLID":
            area.spaces.active.shading.color_type = "VERTEX"
