# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlay and named images of views: over camera view and images, and in an Image Editor that comes up.

`show` is what operators call when a view is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...patchnet_addon.image.tone import to_bytes
from ..session.result_images import show_images
from ..session.scene_session import session_of
from ..session.shown_view import view_to_show
from ..session.views import keep_view, view_of_camera
from ..settings.groups import ViewSettings
from . import handlers, mouse, open_pictures, overlay_settings, panel
from .drawing import inspected
from .paint import free_textures
from .unfinished import unfinished_pictures as unfinished_pictures

if TYPE_CHECKING:
    from ..pipeline.views import View

_CLASSES = (*handlers.CLASSES, *mouse.CLASSES, *open_pictures.CLASSES, *panel.CLASSES)


def show(context: bpy.types.Context, views: Sequence[View], wanted: ViewSettings) -> None:
    """Put the pictures of views into images, and into an editor of the user's; the first one's heatmap comes up."""
    heatmaps = []
    for view in views:
        made = view_to_show(view, wanted, context.scene.patchnet.heatmap_maximum)
        heatmaps.append(show_images(view, made)["heatmap"])
        if not bpy.app.background:  # nobody looks
            keep_view(context.scene, made)
    _come_up(context, heatmaps[0])


def add(context: bpy.types.Context, camera: str, name: str, image: bpy.types.Image, picture: np.ndarray) -> None:
    """Add a picture, encoded colours, to a camera's view, and show its image in an editor of the user's."""
    view = view_of_camera(context.scene, camera)
    if view is not None:
        view.looks[name] = to_bytes(picture)
    _come_up(context, image)


def _come_up(context: bpy.types.Context, image: bpy.types.Image) -> None:
    open_pictures.open_picture(context, image)
    free_textures()
    overlay_settings.refresh(context)


def forget(context: bpy.types.Context) -> None:
    """Free what overlay and inspection hold of a scene."""
    session_of(context.scene).views.clear()
    _switch_off()


@persistent
def _switch_off(*_: object) -> None:
    """Nothing is shown any more, and nothing is inspected; also when another file is opened."""
    inspected.clear()
    values = overlay_settings.overlay_settings(bpy.context)
    values.show_viewport = values.show_editor = False


def register() -> None:
    """Settings, operators, panels; after the main panel."""
    overlay_settings.register()
    handlers.register()
    for item in _CLASSES:
        bpy.utils.register_class(item)
    bpy.app.handlers.load_pre.append(_switch_off)


def unregister() -> None:
    """Unregister all, with callbacks and textures."""
    bpy.app.handlers.load_pre.remove(_switch_off)
    handlers.unregister()
    open_pictures.unregister()
    inspected.clear()
    for item in reversed(_CLASSES):
        bpy.utils.unregister_class(item)
    overlay_settings.unregister()
