# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that switches the overlay on and off."""

from __future__ import annotations

import bpy

from ..session import views
from . import handlers
from .overlay_settings import overlay_settings

NO_VIEW = "There are no pictures yet: run Render Preview first"


class PATCHNET_OT_toggle_overlay(bpy.types.Operator):
    """Lay the chosen picture over the camera's view, or over the image in an Image Editor"""

    bl_idname = "patchnet.toggle_overlay"
    bl_label = "Overlay"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require a picture, except to switch off."""
        values = overlay_settings(context)
        if not (views.has_views(context.scene) or values.show_viewport or values.show_editor):
            cls.poll_message_set(NO_VIEW)
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Switch it where it was pressed; in other editors that of the viewport."""
        values = overlay_settings(context)
        name = "show_editor" if context.area is not None and context.area.type == "IMAGE_EDITOR" else "show_viewport"
        setattr(values, name, not getattr(values, name))
        handlers.refresh(context)
        return {"FINISHED"}


CLASSES = (PATCHNET_OT_toggle_overlay,)
