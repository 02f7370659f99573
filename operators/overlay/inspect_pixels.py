# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that shows the values of the pixel under the mouse, beside it."""

from __future__ import annotations

from typing import ClassVar

import bpy

from ..session import views
from ..session.scene_session import InspectedPixel, open_sessions, session_of
from . import handlers
from .drawing import maximum_of
from .framed import CursorPosition, framed, position_under
from .handlers import NO_VIEW
from .layout import pixel_at


class PATCHNET_OT_inspect_pixels(bpy.types.Operator):
    """Show coverage, luminance, priority and level of the pixel under the mouse, over the camera's view and PatchNet's
    images. Other tools go on; Esc, a right click or this button ends it"""

    bl_idname = "patchnet.inspect_pixels"
    bl_label = "Inspect Pixels"
    bl_options = {"REGISTER"}

    _running: ClassVar[set[int]] = set()  # addresses of the windows in which it runs
    _ending: ClassVar[set[int]] = set()  # of those in which it was asked to end

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require a picture, and a window."""
        if bpy.app.background or context.window is None:
            cls.poll_message_set("Pixels are inspected with the mouse, in a window")
            return False
        if not views.has_views(context.scene):
            cls.poll_message_set(NO_VIEW)
            return False
        return True

    @classmethod
    def runs_in(cls, window: bpy.types.Window | None) -> bool:
        """Return whether pixels are inspected in a window."""
        return window is not None and window.as_pointer() in cls._running

    @classmethod
    def forget(cls) -> None:
        """Forget the windows, which have all ended it, or are gone."""
        cls._running.clear()
        cls._ending.clear()
        for session in open_sessions():
            session.inspected.clear()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin in this window, or end there."""
        self._window = context.window.as_pointer()
        if self._window in self._running:
            self._ending.add(self._window)
            return {"FINISHED"}
        self._running.add(self._window)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set("Inspect Pixels: move the mouse over the picture; Esc or right click ends")
        self._look(context, event)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look at the pixel under the mouse; all else is left to others."""
        if self._window in self._ending or not views.has_views(context.scene) or handlers.problem:
            self.cancel(context)
            return {"CANCELLED", "PASS_THROUGH"}
        if event.type == "MOUSEMOVE":
            self._look(context, event)
        elif event.value == "PRESS" and (event.type == "ESC" or self._is_click_away(context, event)):
            self.cancel(context)
            return {"CANCELLED"}
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop when the window closes, too; Blender calls this."""
        self._running.discard(self._window)
        self._ending.discard(self._window)
        for session in open_sessions():
            session.inspected.pop(self._window, None)
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        handlers.refresh(context)

    def _is_click_away(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        """Test for a right click over an editor in which pixels are inspected; elsewhere it opens menus as ever."""
        return event.type == "RIGHTMOUSE" and position_under(context.window, event.mouse_x, event.mouse_y) is not None

    def _look(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        cursor = position_under(context.window, event.mouse_x, event.mouse_y)
        said = self._said(context, cursor) if cursor is not None else None
        inspected = session_of(context.scene).inspected
        before = inspected.pop(self._window, None)
        if cursor is not None and said:
            inspected[self._window] = InspectedPixel(cursor.region.as_pointer(), cursor.x, cursor.y, said)
        if (before is None) != (not said):
            handlers.refresh(context)
        elif cursor is not None and said:
            cursor.region.tag_redraw()
            if before is not None and before.region != cursor.region.as_pointer():
                handlers.redraw(context)

    def _said(self, context: bpy.types.Context, cursor: CursorPosition) -> list[str]:
        found = framed(context.scene, cursor.area, cursor.region)
        if found is None:
            return []
        pixels = (pixel_at(rect, found.view.size_px, cursor.x, cursor.y) for rect in found.rects)
        pixel = next((item for item in pixels if item is not None), None)
        return found.view.describe_pixel(*pixel, maximum_of(context.scene, found.view)) if pixel is not None else []


CLASSES = (PATCHNET_OT_inspect_pixels,)
