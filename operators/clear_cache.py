# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that clears the disk cache: kernels, light of bakes, finished octrees."""

from __future__ import annotations

import bpy

from .jobs.polls import no_job_runs
from .properties.preferences import apply_preferences, kept
from .session.cache_size import cache_size, clear_cache


class PATCHNET_OT_clear_cache(bpy.types.Operator):
    """Delete compiled kernels, light of bakes and finished octrees from the cache folder, and nothing else.
    Kernels are compiled again when needed, bakes begin anew, and files that are opened have no
    voxels"""

    bl_idname = "patchnet.clear_cache"
    bl_label = "Clear Cache"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """Require that no job runs, which may use the cache."""
        return no_job_runs(cls)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete, and say what is left."""
        from ..patchnet_addon.runtime.cache_folder import user_cache_folder

        apply_preferences(context)
        root = user_cache_folder()
        freed = clear_cache(root)
        kept.cache = cache_size(root).text()
        self.report({"INFO"}, f"{freed / 2**20:.1f} MiB were freed in {root}")
        return {"FINISHED"}


CLASSES = (PATCHNET_OT_clear_cache,)
