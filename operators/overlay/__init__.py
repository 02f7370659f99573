# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlay of views over the camera view and images, and their named images in an Image Editor.

Operators call `show` with a finished view.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...patchnet_addon.image.tone import to_bytes
from ...patchnet_addon.runtime.progress import Steps
from ..session.scene_session import session_of
from ..session.shown_view import view_to_show
from ..session.views import show_images
from ..settings.groups import ViewSettings
from . import open_pictures, overlay_settings
from .open_pictures import unfinished_pictures as unfinished_pictures
from .paint import textures

if TYPE_CHECKING:
    from ..computing.views import View


def show(context: bpy.types.Context, views: Sequence[View], wanted: ViewSettings) -> Steps[None]:
    """Write the pictures of views into images, and show the first view's heatmap in an Image Editor."""
    heatmaps = []
    for view in views:
        made = view_to_show(view, wanted, context.scene.patchnet.heatmap_maximum)
        heatmaps.append((yield from show_images(view, made))["heatmap"])
        if not bpy.app.background:  # no editor draws views
            session_of(context.scene).views[made.camera.name] = made
    _come_up(context, heatmaps[0])


def add(context: bpy.types.Context, camera: str, name: str, image: bpy.types.Image, picture: np.ndarray) -> None:
    """Add a picture, encoded colours, to a camera's view, and show its image in an Image Editor."""
    view = session_of(context.scene).views.get(camera)
    if view is not None:
        view.looks[name] = to_bytes(picture)
    _come_up(context, image)


def _come_up(context: bpy.types.Context, image: bpy.types.Image) -> None:
    open_pictures.open_picture(context, image)
    textures().free()
    overlay_settings.refresh(context)


def forget(context: bpy.types.Context) -> None:
    """Free what overlay and inspection hold of a scene."""
    session_of(context.scene).views.clear()
    _switch_off()


@persistent
def _switch_off(*_: object) -> None:
    """Switch overlay and inspection off; also before another file opens."""
    overlay_settings.overlay_state().inspected.clear()
    values = overlay_settings.overlay_settings(bpy.context)
    values.show_viewport = values.show_editor = False


HANDLERS = (("load_pre", _switch_off),)
