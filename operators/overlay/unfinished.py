# SPDX-License-Identifier: GPL-3.0-or-later
"""Image of what a job has so far, in an Image Editor or a 3D viewport while it works and never in a file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..properties.preferences import OPEN_NEVER, preferences
from ..scene_access.images import write_pixels
from ..scene_access.own import OWNER
from ..scene_access.temporary import temporary
from . import open_pictures
from .unfinished_viewport import UnfinishedViewport

if TYPE_CHECKING:
    from ..pipeline.unfinished import Meanwhile, Unfinished

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
