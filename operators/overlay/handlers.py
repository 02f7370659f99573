# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw handlers, added while something is shown and removed with it; an error in them is reported once."""

from __future__ import annotations

from typing import Any

import bpy

from ...patchnet_addon.runtime import log
from ..session import views
from ..session.scene_session import open_sessions
from . import handlers
from .drawing import draw_region
from .framed import EDITORS
from .overlay_settings import listeners, overlay_settings
from .paint import free_shader, free_textures

_handles: dict[Any, Any] = {}  # by the space type that they draw in
problem = ""  # why the overlay went off, for the panel


def refresh(context: bpy.types.Context) -> None:
    """Handlers come and go as settings have it, and everything is drawn again."""
    if bpy.app.background:
        return
    values = overlay_settings(context)
    if values.show_viewport or values.show_editor or any(session.inspected for session in open_sessions()):
        _add()
    else:
        remove()
    redraw(context)


def redraw(context: bpy.types.Context) -> None:
    """Draw viewports and Image Editors again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in EDITORS:
                area.tag_redraw()


def is_drawing() -> bool:
    """Return whether handlers are there."""
    return bool(_handles)


def remove() -> None:
    """Take the handlers away, and the textures with them."""
    while _handles:
        space, handle = _handles.popitem()
        space.draw_handler_remove(handle, "WINDOW")
    free_textures()
    free_shader()


def switch_off(context: bpy.types.Context) -> None:
    """Nothing is shown any more, and nothing is inspected."""
    for session in open_sessions():
        session.inspected.clear()
    values = overlay_settings(context)
    if values.show_viewport or values.show_editor:
        values.show_viewport = values.show_editor = False
    remove()
    redraw(context)


def _add() -> None:
    global problem
    if _handles:
        return
    problem = ""
    for space in (bpy.types.SpaceView3D, bpy.types.SpaceImageEditor):
        _handles[space] = space.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def _draw() -> None:
    """Blender calls this for every region. It must not raise again and again: the first error ends it."""
    if problem:
        return
    try:
        draw_region(bpy.context)
    except Exception as error:  # noqa: BLE001  whatever it is, it would come with every redraw
        _fail(error)


def _fail(error: Exception) -> None:
    """Report an error once; handlers cannot be taken away while they run, so that is done right after."""
    global problem
    problem = f"The overlay cannot be drawn and went off: {error}"
    log.unexpected(error)
    bpy.app.timers.register(_end_after_error, first_interval=0.0)


def _end_after_error() -> None:
    switch_off(bpy.context)
    windows = bpy.context.window_manager.windows
    if windows:
        with bpy.context.temp_override(window=windows[0]):
            bpy.context.window_manager.popup_menu(_say_problem, title="PatchNet", icon="ERROR")


def _say_problem(menu: bpy.types.UIPopupMenu, _context: bpy.types.Context) -> None:
    menu.layout.label(text=problem)


def register() -> None:
    """Follow the settings."""
    listeners.append(refresh)


def unregister() -> None:
    """Leave nothing behind."""
    listeners.remove(refresh)
    if bpy.app.timers.is_registered(_end_after_error):
        bpy.app.timers.unregister(_end_after_error)
    remove()


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
