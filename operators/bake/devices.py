# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles computes on."""

from __future__ import annotations

import bpy


def gpu_is_enabled(context: bpy.types.Context) -> bool:
    """Whether a GPU is enabled in the preferences of Cycles; it then bakes, whatever the scene's file says."""
    addon = context.preferences.addons.get("cycles")
    return addon is not None and bool(addon.preferences.has_active_device())
