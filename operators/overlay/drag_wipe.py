# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that drags the line of the wipe between two pictures with the mouse."""

from __future__ import annotations

import bpy

from ..session import views
from .framed import framed, position_under
from .handlers import NO_VIEW
from .layout import wipe_at
from .overlay_settings import overlay_settings


class PATCHNET_OT_drag_wipe(bpy.types.Operator):
    """Move the line between the two pictures with the mouse: click to leave it there, Esc or right click to go back"""

    bl_idname = "patchnet.drag_wipe"
    bl_label = "Drag Wipe"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require a picture, and a window."""
        if bpy.app.background or context.window is None:
            cls.poll_message_set("The wipe is dragged with the mouse, in a window")
            return False
        if not views.has_views(context.scene):
            cls.poll_message_set(NO_VIEW)
            return False
        return True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Show the overlay where the button is, with a wipe."""
        values = overlay_settings(context)
        self._before = values.use_wipe, values.wipe
        in_editor = context.area is not None and context.area.type == "IMAGE_EDITOR"
        setattr(values, "show_editor" if in_editor else "show_viewport", True)
        values.use_wipe = True
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set("Wipe: the line follows the mouse; click to leave it there, Esc goes back")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse; navigation goes on."""
        values = overlay_settings(context)
        if event.type == "MOUSEMOVE":
            self._follow(context, event)
            return {"RUNNING_MODAL"}
        if event.type in {"LEFTMOUSE", "RET", "NUMPAD_ENTER"} and event.value == "PRESS":
            context.workspace.status_text_set(None)
            return {"FINISHED"}
        if event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        return {"PASS_THROUGH"} if values.use_wipe else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop when the window closes, too; Blender calls this."""
        values = overlay_settings(context)
        values.use_wipe, values.wipe = self._before
        context.workspace.status_text_set(None)

    def _follow(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        cursor = position_under(context.window, event.mouse_x, event.mouse_y)
        found = framed(context.scene, cursor.area, cursor.region) if cursor else None
        if cursor is not None and found is not None and found.rect is not None:
            overlay_settings(context).wipe = wipe_at(found.rect, cursor.x)


CLASSES = (PATCHNET_OT_drag_wipe,)
