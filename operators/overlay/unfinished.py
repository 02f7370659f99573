# SPDX-License-Identifier: GPL-3.0-or-later
"""Display of a job's unfinished picture in an Image Editor or a 3D viewport; the picture is never saved.

Without a free Image Editor it lies in the lower right corner of the largest 3D viewport: no window opens unasked.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...patchnet_addon.runtime import log
from ..properties.preferences import OPEN_NEVER, preferences
from ..scene_access.images import write_pixels
from ..scene_access.own import OWNER
from ..scene_access.temporary import temporary
from . import open_pictures, paint
from .framed import free_rect
from .layout import Rect

if TYPE_CHECKING:
    from ..pipeline.unfinished import Meanwhile, Unfinished

NAME = "PatchNet unfinished"
_INSET = 0.4  # of the viewport's sides, at most
_GAP_PX = 8


@contextmanager
def unfinished_pictures(context: bpy.types.Context) -> Iterator[Meanwhile | None]:
    """Function that shows unfinished pictures within the block, None in background; then editors are as before.

    Without a free Image Editor a 3D viewport shows them, unless the preferences open no pictures.
    """
    if bpy.app.background:
        yield None
        return
    with temporary(bpy.data.images.new(NAME, 8, 8, alpha=False)) as image:
        image[OWNER] = NAME
        inset = Inset()
        before = [(area.spaces.active, area.spaces.active.image) for area in _areas(context, "IMAGE_EDITOR")]
        try:
            yield lambda unfinished: _show(context, image, inset, unfinished)
        finally:
            inset.show(context, None)
            for space, shown in before:
                with suppress(ReferenceError):  # the editor or its image was removed
                    if space.image == image:
                        space.image = shown


def _areas(context: bpy.types.Context, kind: str) -> list[bpy.types.Area]:
    windows = context.window_manager.windows
    return [area for window in windows for area in window.screen.areas if area.type == kind]


def _show(context: bpy.types.Context, image: bpy.types.Image, inset: Inset, unfinished: Unfinished) -> None:
    with suppress(ReferenceError):  # another file was opened, or the user removed it
        page = unfinished.page().astype(np.float32)
        resized = tuple(image.size) != (page.shape[1], page.shape[0])
        write_pixels(image, page)
        image.pack()  # else Blender asks about an unsaved image if the user saves the file
        # No new window: it would take the keyboard focus.
        if not open_pictures.open_picture(context, image, new_window=False):
            inset.show(context, unfinished if preferences(context).open_pictures != OPEN_NEVER else None)
            return
        inset.show(context, None)
        for area in _areas(context, "IMAGE_EDITOR"):
            if area.spaces.active.image == image:
                if resized:
                    open_pictures.fit_editor(context, area)
                area.tag_redraw()


class Inset:
    """Last unfinished picture in a viewport, with a draw handler only while there is a picture."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._texture: Any = None
        self.shown: Unfinished | None = None

    def show(self, context: bpy.types.Context, unfinished: Unfinished | None) -> None:
        """Replace the picture; None removes it."""
        if unfinished is self.shown is None:
            return
        self.shown, self._texture = unfinished, None
        if self._handle is None:
            self._handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        if unfinished is None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
            self._handle = None
        for area in _areas(context, "VIEW_3D"):
            area.tag_redraw()

    def _draw(self) -> None:
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
    viewports = [item for item in _areas(context, "VIEW_3D") if item.spaces.active.overlay.show_overlays]
    largest = max(viewports, key=lambda item: item.width * item.height, default=None)
    if area is None or area != largest or region != next(item for item in area.regions if item.type == "WINDOW"):
        return None
    room, aspect = free_rect(area, region), picture.shape[1] / picture.shape[0]
    gap = _GAP_PX * context.preferences.system.ui_scale
    width = _INSET * min(room.width, room.height * aspect)
    right, bottom = room.right - gap, room.bottom + gap
    return Rect(right - width, bottom, right, bottom + width / aspect)
