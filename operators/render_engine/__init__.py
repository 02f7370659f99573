# SPDX-License-Identifier: GPL-3.0-or-later
"""Render engine "PatchNet": final renders with passes, and a shading mode for viewports."""

from __future__ import annotations

import sys
from typing import Any

import bpy

from ..gpu_view import cards
from ..scene_access.stop_cycles import forget_engine
from ..session.scene_session import in_main_thread, open_sessions
from . import engine, panels, viewport

_CLASSES = (*engine.CLASSES, *panels.CLASSES)


def register() -> None:
    """Make the engine known, and Blender's panels to it."""
    for item in _CLASSES:
        bpy.utils.register_class(item)
    panels.add_to_blenders()
    for handlers in _ends_of_renders():
        handlers.append(_forget_frames)


def unregister() -> None:
    """Forget the engine."""
    for handlers in _ends_of_renders():
        handlers.remove(_forget_frames)
    panels.remove_from_blenders()
    for item in reversed(panels.CLASSES):
        bpy.utils.unregister_class(item)
    for item in engine.CLASSES:
        forget_engine(item)
    viewport.unregister()


def _ends_of_renders() -> tuple[list[Any], ...]:
    lists = bpy.app.handlers
    return lists.render_complete, lists.render_cancel, lists.load_post


@bpy.app.handlers.persistent
def _forget_frames(*_: object) -> None:
    """Free what was made for frames of an animation, and what the allocator kept of their arrays."""
    from ...patchnet_addon.runtime.heap import trim

    for session in open_sessions():
        session.free_frames()
    if in_main_thread():  # not that of a render, which has no graphics context
        cards.free_coming()
    if f"{__package__}.frame_octree" in sys.modules:  # else nothing of ours was rendered
        trim()
