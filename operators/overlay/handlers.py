# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw handlers, added while something is shown and removed with it; an error in them is reported once."""

from __future__ import annotations

from typing import Any

import bpy

from ...patchnet_addon.runtime import log
from .framed import EDITORS
from .paint import free_shader
from .settings import overlay_settings
from .textures import free_textures

_handles: dict[Any, Any] = {}  # by the space type that they draw in
problem = ""  # why the overlay went off, for the panel


def refresh(context: bpy.types.Context) -> None:
    """Handlers come and go as settings have it, and everything is drawn again."""
    from .drawing import inspected

    if bpy.app.background:
        return
    values = overlay_settings(context)
    if values.show_viewport or values.show_editor or inspected:
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
    """Switch everything off that is shown or inspected."""
    from .drawing import inspected

    inspected.clear()
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
    """Draw a region, for which Blender calls this; it must not raise again and again: the first error ends it."""
    from .drawing import draw_region

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


def unregister() -> None:
    """Leave nothing behind."""
    if bpy.app.timers.is_registered(_end_after_error):
        bpy.app.timers.unregister(_end_after_error)
    remove()
