# SPDX-License-Identifier: GPL-3.0-or-later
"""Operator that follows the mouse over pictures and shows the values of a pixel."""

from __future__ import annotations

import bpy

from ..session.scene_session import session_of
from .drawing import NO_VIEW
from .framed import UnderMouse, pixel_at, under_mouse
from .overlay_settings import InspectedPixel, overlay_state, refresh


class PATCHNET_OT_inspect_pixels(bpy.types.Operator):
    """Show coverage, luminance, priority, level and samples of the pixel under the mouse, until Esc or a right click"""

    bl_idname = "patchnet.inspect_pixels"
    bl_label = "Inspect Pixels"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require a picture and a window."""
        without_window = bpy.app.background or context.window is None
        if without_window or not _has_pictures(context):
            cls.poll_message_set(f"{cls.bl_label} needs the mouse, in a window" if without_window else NO_VIEW)
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Start in this window, or stop if it runs there."""
        self._window, inspected = context.window.as_pointer(), overlay_state().inspected
        if self._window in inspected:
            del inspected[self._window]  # the running operator ends at its next event
            return {"FINISHED"}
        inspected[self._window] = None
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set("Inspect Pixels: move the mouse over the picture; Esc or right click ends")
        self._look(context, event)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Update the pixel under the mouse; all other events pass through."""
        state = overlay_state()
        if self._window not in state.inspected or not _has_pictures(context) or state.problem:
            self.cancel(context)
            return {"CANCELLED", "PASS_THROUGH"}
        if event.type == "MOUSEMOVE":
            self._look(context, event)
        elif event.value == "PRESS" and (
            event.type == "ESC" or (event.type == "RIGHTMOUSE" and under_mouse(context, event) is not None)
        ):  # elsewhere a right click opens menus
            self.cancel(context)
            return {"CANCELLED"}
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop, also when Blender closes the window."""
        overlay_state().inspected.pop(self._window, None)
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        refresh(context)

    def _look(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        cursor, inspected = under_mouse(context, event), overlay_state().inspected
        before = inspected[self._window]
        lines = [] if cursor is None else _lines(context, cursor)
        now = InspectedPixel(cursor.region.as_pointer(), cursor.x, cursor.y, lines) if cursor and lines else None
        inspected[self._window] = now
        if cursor is not None and now is not None:
            cursor.region.tag_redraw()
        if before is not None and (now is None or before.region != now.region):
            refresh(context)


def _has_pictures(context: bpy.types.Context) -> bool:
    """Return whether there is a picture or a live heatmap."""
    return bool(overlay_state().heatmaps) or bool(session_of(context.scene).views)


def _lines(context: bpy.types.Context, cursor: UnderMouse) -> list[str]:
    """Lines about the pixel under the mouse, first choice a live heatmap; none beside pictures."""
    if heat := overlay_state().heatmaps.get(cursor.region.as_pointer()):
        return heat.describe_pixel(int(cursor.x), int(cursor.y))
    if cursor.framed is None:
        return []
    view, rects = cursor.framed
    pixels = (pixel_at(rect, view.size_px, cursor.x, cursor.y) for rect in rects)
    pixel = next((item for item in pixels if item is not None), None)
    maximum = view.maximum_now(context.scene.patchnet.heatmap_maximum)
    return view.describe_pixel(*pixel, maximum) if pixel is not None else []
