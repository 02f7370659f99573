# SPDX-License-Identifier: GPL-3.0-or-later
"""Image of what a job has so far, in an Image Editor or a 3D viewport while it works and never in a file.

Where no Image Editor is free, 3D viewports show them: no window opens unasked. A viewport that looks through the
picture's camera shows it in the camera's frame; where none does, the largest one has it in its lower right corner.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...patchnet_addon.runtime import log
from ..properties.preferences import OPEN_NEVER, preferences
from ..scene.cameras import camera_name, tracing_camera
from ..scene_access.images import write_pixels
from ..scene_access.own import OWNER
from ..scene_access.temporary import temporary
from . import open_pictures, paint
from .framed import free_rect
from .layout import Rect, frame_rect, inset_rect
from .paint import uploaded

if TYPE_CHECKING:
    from ..pipeline.unfinished import Meanwhile, Unfinished
if TYPE_CHECKING:
    from ..pipeline.unfinished import Unfinished

NAME = "PatchNet unfinished"


@contextmanager
def unfinished_pictures(context: bpy.types.Context) -> Iterator[Meanwhile | None]:
    """Function that shows unfinished pictures within the block, None in background; editors then show what they did.

    Where no Image Editor is free, 3D viewports show them, unless the preferences say that nothing opens.
    """
    if bpy.app.background:
        yield None
        return
    with temporary(bpy.data.images.new(NAME, 8, 8, alpha=False)) as image:
        image[OWNER] = NAME
        viewport = UnfinishedViewport()
        before = [(area.spaces.active, area.spaces.active.image) for area in _editors(context)]
        try:
            yield lambda unfinished: _show(context, image, viewport, unfinished)
        finally:
            viewport.end(context)
            for space, shown in before:
                with suppress(ReferenceError):  # the editor is gone, or what it showed
                    if space.image == image:
                        space.image = shown


def _editors(context: bpy.types.Context) -> list[bpy.types.Area]:
    windows = context.window_manager.windows
    return [area for window in windows for area in window.screen.areas if area.type == "IMAGE_EDITOR"]


def _show(
    context: bpy.types.Context, image: bpy.types.Image, viewport: UnfinishedViewport, unfinished: Unfinished
) -> None:
    with suppress(ReferenceError):  # another file was opened, or the user removed it
        page = unfinished.page().astype(np.float32)
        resized = tuple(image.size) != (page.shape[1], page.shape[0])
        write_pixels(image, page)
        image.pack()  # else Blender asks what to do about it where a user saves meanwhile
        # A new window would take the keyboard from a user.
        if not open_pictures.open_picture(context, image, new_window=False):
            if preferences(context).open_pictures != OPEN_NEVER:
                viewport.show(context, unfinished)
            return
        viewport.end(context)
        for area in _editors(context):
            if area.spaces.active.image == image:
                if resized:
                    open_pictures.fit_editor(context, area)
                area.tag_redraw()


_INSET = 0.4  # of the viewport's sides, at most
_GAP_PX = 8


class UnfinishedViewport:
    """Draw handler of the last unfinished picture; made when the first one comes, gone with `end`."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._texture: Any = None
        self.shown: Unfinished | None = None

    def show(self, context: bpy.types.Context, unfinished: Unfinished) -> None:
        """Show a picture in the place of the last one."""
        self.shown, self._texture = unfinished, None
        if self._handle is None:
            self._handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        _redraw(context)

    def end(self, context: bpy.types.Context) -> None:
        """Show nothing any more."""
        if self._handle is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
            _redraw(context)
        self._handle = self._texture = self.shown = None

    def _draw(self) -> None:
        """Blender calls this for every region of every viewport; the first error ends it."""
        if self.shown is None:
            return
        try:
            rect = place_of(bpy.context, self.shown)
            if rect is not None:
                self._paint(bpy.context, rect, self.shown)
        except Exception as error:  # noqa: BLE001  whatever it is, it would come with every redraw
            self.shown = None
            log.unexpected(error)

    def _paint(self, context: bpy.types.Context, rect: Rect, unfinished: Unfinished) -> None:
        if self._texture is None:
            self._texture = uploaded(unfinished.picture)
        paint.picture(self._texture, rect, rect, 1.0)
        scale = context.preferences.system.ui_scale
        text = f"{unfinished.camera}: {unfinished.title}"
        gap, height = _GAP_PX * scale, paint.box_size([text], scale)[1]
        seen = rect.meet(free_rect(context.area, context.region))
        if not seen.empty:
            paint.box([(text, paint.WARNING)], (seen.left + gap, seen.top - gap - height), scale)


def place_of(context: bpy.types.Context, unfinished: Unfinished) -> Rect | None:
    """Rectangle of a picture in the region that is being drawn; None where another viewport has it, or none is to."""
    area, region = context.area, context.region
    if area is None or region.data is None or not area.spaces.active.overlay.show_overlays:
        return None
    frame = _frame(context, area, region, unfinished)
    if frame is not None:
        return frame
    viewports = [item for window in context.window_manager.windows for item in window.screen.areas
                 if item.type == "VIEW_3D" and item.spaces.active.overlay.show_overlays]  # fmt: skip
    framing = [item for item in viewports if _frame(context, item, _main(item), unfinished) is not None]
    largest = max(viewports, key=lambda item: item.width * item.height)
    if framing or largest != area or region != _main(area):
        return None
    height, width = unfinished.picture.shape[:2]
    return inset_rect(free_rect(area, region), width / height, _INSET, _GAP_PX * context.preferences.system.ui_scale)


def _main(area: bpy.types.Area) -> bpy.types.Region:
    return next(region for region in area.regions if region.type == "WINDOW")


def _frame(
    context: bpy.types.Context, area: bpy.types.Area, region: bpy.types.Region, unfinished: Unfinished
) -> Rect | None:
    """Rectangle of the camera's frame in a viewport that looks through the picture's camera."""
    space, view3d, scene = area.spaces.active, region.data, context.scene
    camera = space.camera if space.use_local_camera else scene.camera
    if view3d is None or view3d.view_perspective != "CAMERA" or camera is None:
        return None
    if camera_name(scene, camera) != unfinished.camera:
        return None
    height, width = unfinished.picture.shape[:2]
    seen = tracing_camera(camera, scene, (width, height))  # not the evaluated one: nothing is evaluated while one draws
    return frame_rect(seen, view3d.window_matrix, region.width, region.height)


def _redraw(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
