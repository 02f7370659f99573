# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlay and named images of views: over camera view and images, and in an Image Editor that comes up.

`show` is what operators call when a view is there. Blender's drawing callbacks live only while something is shown.
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
from . import drag_wipe, handlers, inspect_pixels, open_pictures, overlay_settings, panel
from .unfinished import unfinished_pictures as unfinished_pictures

if TYPE_CHECKING:
    from ..pipeline.views import View

_MODULES = (handlers, drag_wipe, inspect_pixels, open_pictures, panel)
_CLASSES = tuple(item for module in _MODULES for item in module.CLASSES)


def show(context: bpy.types.Context, views: Sequence[View], wanted: ViewSettings) -> None:
    """Put the pictures of views into images, and into an editor of the user's; the first one's heatmap comes up."""
    heatmaps = []
    for view in views:
        made = view_to_show(view, wanted, context.scene.patchnet.heatmap_maximum)
        heatmaps.append(show_images(view, made)["heatmap"])
        if not bpy.app.background:  # nobody looks
            keep_view(context.scene, made)
    open_pictures.open_picture(context, heatmaps[0])
    handlers.refresh(context)


def add(context: bpy.types.Context, camera: str, name: str, image: bpy.types.Image, picture: np.ndarray) -> None:
    """Add a picture, encoded colours, to a camera's view, and show its image in an editor of the user's."""
    view = view_of_camera(context.scene, camera)
    if view is not None:
        view.looks[name] = to_bytes(picture)
    open_pictures.open_picture(context, image)
    handlers.refresh(context)


def forget(context: bpy.types.Context) -> None:
    """Free what overlay and inspection hold of a scene."""
    session_of(context.scene).views.clear()
    inspect_pixels.PATCHNET_OT_inspect_pixels.forget()
    handlers.switch_off(context)


@persistent
def _on_load_pre(_path: str) -> None:
    """Forget what is shown, which belongs to the file that is being closed."""
    inspect_pixels.PATCHNET_OT_inspect_pixels.forget()
    handlers.switch_off(bpy.context)


def register() -> None:
    """Settings, operators, panels; after the main panel."""
    overlay_settings.register()
    handlers.register()
    for item in _CLASSES:
        bpy.utils.register_class(item)
    bpy.app.handlers.load_pre.append(_on_load_pre)


def unregister() -> None:
    """Unregister all, with callbacks and textures."""
    bpy.app.handlers.load_pre.remove(_on_load_pre)
    handlers.unregister()
    open_pictures.unregister()
    inspect_pixels.PATCHNET_OT_inspect_pixels.forget()
    for item in reversed(_CLASSES):
        bpy.utils.unregister_class(item)
    overlay_settings.unregister()
