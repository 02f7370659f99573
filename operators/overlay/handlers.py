# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw handlers of the overlay, which the first error switches off, and the operator that switches it."""

from __future__ import annotations

from typing import Any

import bpy

from ...patchnet_addon.runtime import log
from ..session import views
from . import overlay_settings as settings
from .drawing import draw_region
from .overlay_settings import overlay_settings
from .paint import free_shader, free_textures

NO_VIEW = "There are no pictures yet: run Render Preview first"
_handles: dict[Any, Any] = {}  # by the space type that they draw in


def _draw() -> None:
    """Draw in the current region; the first error switches the overlay off, as each redraw would repeat it."""
    if settings.problem:
        return
    try:
        draw_region(bpy.context)
    except Exception as error:  # noqa: BLE001  any error would come again with every redraw
        settings.fail(f"The overlay cannot be drawn and is switched off: {error}")
        log.unexpected(error)


def register() -> None:
    """Add the draw handlers of viewports and Image Editors."""
    for space in (bpy.types.SpaceView3D, bpy.types.SpaceImageEditor):
        _handles[space] = space.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def unregister() -> None:
    """Remove the draw handlers, textures and the shader."""
    while _handles:
        space, handle = _handles.popitem()
        space.draw_handler_remove(handle, "WINDOW")
    free_textures()
    free_shader()


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
        """Switch the overlay of this editor; in other editors that of the viewport."""
        values, name = overlay_settings(context), switch_of(context)
        setattr(values, name, not getattr(values, name))
        return {"FINISHED"}


def switch_of(context: bpy.types.Context) -> str:
    """Name of the setting that switches the overlay of the current editor."""
    return "show_editor" if context.area is not None and context.area.type == "IMAGE_EDITOR" else "show_viewport"


CLASSES = (PATCHNET_OT_toggle_overlay,)
