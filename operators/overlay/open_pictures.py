# SPDX-License-Identifier: GPL-3.0-or-later
"""Show pictures in Image Editors or new windows; editors that show an image of the user's stay as they are."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
from bpy.props import StringProperty

from ..properties.preferences import OPEN_NEVER, OPEN_WINDOW, preferences
from ..scene_access.own import OWNER, is_own

_waiting: list[str] = []  # names of images that wait for a window


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


def open_picture(
    context: bpy.types.Context, image: bpy.types.Image, *, new_window: bool = True, asked: bool = False
) -> bool:
    """Show `image` in a free Image Editor or as the preferences say; returns whether it is or will be shown.

    new_window: a window may open if no editor is free. asked: by a button; preferences do not count. Background: False.
    A timer opens the window: an operator that opened it during its event would not be released by its own window.
    """
    chosen = OPEN_WINDOW if asked else preferences(context).open_pictures
    if bpy.app.background or chosen == OPEN_NEVER:
        return False
    editors = list(_editors(context))
    if any(area.spaces.active.image == image for _, area in editors):
        return True
    free = [(window, area) for window, area in editors if _is_free(area.spaces.active)]
    if free:
        _show(*max(free, key=lambda item: item[1].width * item[1].height), image)
        return True
    if not new_window or chosen != OPEN_WINDOW:
        return False
    _waiting.append(image.name)
    if not bpy.app.timers.is_registered(_open_windows):
        bpy.app.timers.register(_open_windows, first_interval=0.0)
    return True


def unregister() -> None:
    """Discard waiting pictures and the timer."""
    _waiting.clear()
    if bpy.app.timers.is_registered(_open_windows):
        bpy.app.timers.unregister(_open_windows)


def _open_windows() -> None:
    while _waiting:
        image = bpy.data.images.get(_waiting.pop(0))
        found = _new_window(bpy.context) if image is not None else None
        if image is not None and found is not None:
            _show(*found, image)


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


def fit_editor(context: bpy.types.Context, area: bpy.types.Area) -> None:
    """Fit the whole picture into an editor of any window."""
    for window in context.window_manager.windows:
        if area in window.screen.areas.values():
            _fit(window, area)


def _fit(window: bpy.types.Window, area: bpy.types.Area) -> None:
    """Fit the whole picture into the editor."""
    region = next((item for item in area.regions if item.type == "WINDOW"), None)
    if region is None or min(region.width, region.height) < 2:
        return
    with bpy.context.temp_override(window=window, area=area, region=region):
        if bpy.ops.image.view_all.poll():
            bpy.ops.image.view_all(fit_view=True)


CLASSES = (PATCHNET_OT_show_picture,)
