# SPDX-License-Identifier: GPL-3.0-or-later
"""Image Editors during a bake, which Blender shows its image in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import bpy


@contextmanager
def editors_keep_images(manager: bpy.types.WindowManager) -> Iterator[Callable[[], None]]:
    """Image Editors show what they did before: a bake puts its image into the largest, as a job into all of them.

    The value gives the images back at once; Blender takes the editors soon after a job began, not right then.
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
