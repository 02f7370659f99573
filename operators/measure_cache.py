# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that measures the disk cache for the preferences, which do not read the disk while they are drawn."""

from __future__ import annotations

import bpy

from .properties.preferences import apply_preferences, kept
from .session.cache_size import cache_size


class PATCHNET_OT_measure_cache(bpy.types.Operator):
    """Look how much compiled kernels, light of bakes and finished octrees take in the cache folder"""

    bl_idname = "patchnet.measure_cache"
    bl_label = "Measure Cache"
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Measure, and keep the text."""
        from ..patchnet_addon.runtime.cache_folder import user_cache_folder

        apply_preferences(context)
        kept.cache = cache_size(user_cache_folder()).text()
        self.report({"INFO"}, f"Cache: {kept.cache}")
        return {"FINISHED"}


CLASSES = (PATCHNET_OT_measure_cache,)
