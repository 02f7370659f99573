# SPDX-License-Identifier: GPL-3.0-or-later
"""Show pictures in Image Editors or new windows; editors that show an image of the user's stay as they are.

A job's unfinished picture lies in the lower right corner of the largest 3D viewport.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from bpy.props import StringProperty

from ...patchnet_addon.runtime import log
from ..properties.preferences import OPEN_NEVER, OPEN_WINDOW, preferences
from ..scene_access.own import OWNER, is_own
from ..session.results import redraw_viewports
from . import paint
from .framed import Rect, free_rect
from .overlay_settings import overlay_state

if TYPE_CHECKING:
    from ...patchnet_addon.image.unfinished import Meanwhile, Unfinished

_INSET = 0.4  # of the viewport's sides, at most
_GAP_PX = 8


class PATCHNET_OT_show_picture(bpy.types.Operator):
    """Show this picture in an Image Editor that shows none of your images, else in a new window"""

    bl_idname = "patchnet.show_picture"
    bl_label = "Show Picture"
    bl_options = {"REGISTER"}

    image: StringProperty(name="Image", description="Which picture, such as PatchNet Camera heatmap")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Find the picture and show it."""
        found = next((item for item in bpy.data.images if item.get(OWNER) == self.image), None)
        if found is None:
            self.report({"ERROR"}, f"There is no picture '{self.image}' any more: run Render Preview again")
            return {"CANCELLED"}
        open_picture(context, found, asked=True)
        return {"FINISHED"}


def open_picture(context: bpy.types.Context, image: bpy.types.Image, *, asked: bool = False) -> None:
    """Show `image` in a free Image Editor or as the preferences say; not in background.

    asked: by a button; preferences do not count.
    A timer opens the window: an operator that opened it during its event would not be released by its own window.
    """
    chosen = OPEN_WINDOW if asked else preferences(context).open_pictures
    if bpy.app.background or chosen == OPEN_NEVER:
        return
    editors = list(_editors(context))
    if any(area.spaces.active.image == image for _, area in editors):
        return
    free = [(window, area) for window, area in editors if _is_free(area.spaces.active)]
    if free:
        _show(*max(free, key=lambda item: item[1].width * item[1].height), image)
    elif chosen == OPEN_WINDOW:
        overlay_state().to_open.append(image.name)
        if not bpy.app.timers.is_registered(_open_windows):
            bpy.app.timers.register(_open_windows, first_interval=0.0)


def _open_windows() -> None:
    names = overlay_state().to_open
    while names:
        image = bpy.data.images.get(names.pop(0))
        found = _new_window(bpy.context) if image is not None else None
        if image is not None and found is not None:
            _show(*found, image)


TIMERS = (_open_windows,)


def _show(window: bpy.types.Window, area: bpy.types.Area, image: bpy.types.Image) -> None:
    area.spaces.active.image = image
    _fit(window, area)
    area.tag_redraw()


def may_replace(image: bpy.types.Image | None) -> bool:
    """Return whether an Image Editor may replace this image: none, a render, or a result of PatchNet."""
    return image is None or image.type in {"RENDER_RESULT", "COMPOSITING"} or is_own(image)


def _is_free(space: bpy.types.SpaceImageEditor) -> bool:
    """Return whether an Image Editor is not in use: neither pinned nor in a mode that edits or masks."""
    pinned = space.use_image_pin and space.image is not None
    return may_replace(space.image) and space.mode == "VIEW" and not pinned


def _editors(context: bpy.types.Context) -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == area.ui_type == "IMAGE_EDITOR":
                yield window, area


def _new_window(context: bpy.types.Context) -> tuple[bpy.types.Window, bpy.types.Area] | None:
    """Open a window with an Image Editor alone.

    It is as large as an editor other than a 3D viewport, over which it comes up: a window of Blender's own choice
    covers the one where the user works.
    """
    manager = context.window_manager
    before = manager.windows.values()
    window = context.window or before[0]
    place = min(window.screen.areas, key=lambda item: (item.type == "VIEW_3D", -min(item.width, item.height)))
    with context.temp_override(window=window, area=place):
        bpy.ops.screen.area_dupli("INVOKE_DEFAULT")
    for window in manager.windows:
        if window not in before:
            area = max(window.screen.areas, key=lambda item: item.width * item.height)
            area.ui_type = "IMAGE_EDITOR"
            return window, area
    return None


def _fit(window: bpy.types.Window, area: bpy.types.Area) -> None:
    """Fit the whole picture into the editor."""
    region = next((item for item in area.regions if item.type == "WINDOW"), None)
    if region is None or min(region.width, region.height) < 2:
        return
    with bpy.context.temp_override(window=window, area=area, region=region):
        if bpy.ops.image.view_all.poll():
            bpy.ops.image.view_all(fit_view=True)


@contextmanager
def unfinished_pictures(context: bpy.types.Context) -> Iterator[Meanwhile | None]:
    """Function that shows unfinished pictures in a viewport within the block.

    None in background, and if the preferences open no pictures.
    """
    if bpy.app.background or preferences(context).open_pictures == OPEN_NEVER:
        yield None
        return
    inset = Inset()
    handle = bpy.types.SpaceView3D.draw_handler_add(inset.draw, (), "WINDOW", "POST_PIXEL")
    try:
        yield inset.show
    finally:
        bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        redraw_viewports()


class Inset:
    """Last unfinished picture in a viewport."""

    def __init__(self) -> None:
        self._texture: Any = None
        self.shown: Unfinished | None = None

    def show(self, unfinished: Unfinished) -> None:
        """Replace the picture."""
        self.shown, self._texture = unfinished, None
        redraw_viewports()

    def draw(self) -> None:
        """Draw in the current region, called for every region of every viewport; the first error ends it."""
        try:
            rect = inset_rect(bpy.context, self.shown.picture) if self.shown is not None else None
            if rect is not None and self.shown is not None:
                self._paint(bpy.context, rect, self.shown)
        except Exception as error:  # noqa: BLE001  any error would come again with every redraw
            self.shown = None
            log.unexpected(error)

    def _paint(self, context: bpy.types.Context, rect: Rect, unfinished: Unfinished) -> None:
        if self._texture is None:
            self._texture = paint.uploaded(unfinished.picture)
        paint.picture(self._texture, rect, rect, 1.0)
        scale = context.preferences.system.ui_scale
        text = f"{unfinished.camera}: {unfinished.title}"
        gap, height = _GAP_PX * scale, paint.box_size([text], scale)[1]
        paint.box([text], (rect.left + gap, rect.top - gap - height), scale, paint.WARNING)


def inset_rect(context: bpy.types.Context, picture: np.ndarray) -> Rect | None:
    """Rectangle of a picture (h, w, 3) in the current region; None for all but the largest viewport's."""
    area, region = context.area, context.region
    areas = [item for window in context.window_manager.windows for item in window.screen.areas]
    viewports = [item for item in areas if item.type == "VIEW_3D" and item.spaces.active.overlay.show_overlays]
    largest = max(viewports, key=lambda item: item.width * item.height, default=None)
    if area is None or area != largest or region != next(item for item in area.regions if item.type == "WINDOW"):
        return None
    room, aspect = free_rect(area, region), picture.shape[1] / picture.shape[0]
    gap = _GAP_PX * context.preferences.system.ui_scale
    width = _INSET * min(room.width, room.height * aspect)
    right, bottom = room.right - gap, room.bottom + gap
    return Rect(right - width, bottom, right, bottom + width / aspect)
