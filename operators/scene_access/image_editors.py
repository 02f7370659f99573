# SPDX-License-Identifier: GPL-3.0-or-later
"""Image Editors during a bake, in which Blender shows the baked image."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import bpy


@contextmanager
def editors_keep_images(manager: bpy.types.WindowManager) -> Iterator[Callable[[], None]]:
    """Restore the images of Image Editors: Blender shows a baked image in the largest one, and a job's in all of them.

    The value restores them at once; Blender replaces the images shortly after a job begins.
    """
    areas = [area for window in manager.windows for area in window.screen.areas if area.type == "IMAGE_EDITOR"]
    shown = [(area.spaces.active, area.spaces.active.image) for area in areas]

    def give_back() -> None:
        for space, image in shown:
            with suppress(ReferenceError):  # the editor or the image is gone
                if space.image != image:
                    space.image = image

    try:
        yield give_back
    finally:
        give_back()
