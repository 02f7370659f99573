# SPDX-License-Identifier: GPL-3.0-or-later
"""Render engine "PatchNet": final renders with passes, and a shading mode for viewports."""

from __future__ import annotations

import bpy

from ..gpu_view import cards
from ..scene_access.main_thread import in_main_thread
from ..scene_access.stop_cycles import forget_engine
from ..session.scene_session import open_sessions
from .engine import PatchNetRenderEngine


def register() -> None:
    """Register the engine."""
    bpy.utils.register_class(PatchNetRenderEngine)


def unregister() -> None:
    """Unregister the engine."""
    forget_engine(PatchNetRenderEngine)


@bpy.app.handlers.persistent
def _forget_frames(*_: object) -> None:
    """Free octrees of the animation's frames."""
    for session in open_sessions():
        session.made_frame = None
    if in_main_thread():  # a render has no graphics context
        cards.free_coming()


HANDLERS = tuple((name, _forget_frames) for name in ("render_complete", "render_cancel", "load_post"))
