# SPDX-License-Identifier: GPL-3.0-or-later
"""Failed file load: a batch job would else work on what is open instead of the file that Blender could not open.

`blender -b damaged.blend` says one line on the terminal and goes on with an untitled scene.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ...patchnet_addon.runtime.errors import SceneError

_unread: list[str] = []  # its path, while nothing was opened since


def check_opened() -> None:
    """Raise SceneError in a Blender without a window that has no file open because the one it was given is damaged."""
    if bpy.app.background and _unread and not bpy.data.filepath:
        raise SceneError(
            f"Scene file {_unread[-1]} could not be opened, it may be damaged: nothing of it is there to work on; "
            "open a file that is whole"
        )


@persistent
def _failed(path: str) -> None:
    _unread[:] = [path]


@persistent
def _opened(_path: str) -> None:
    _unread.clear()


def register() -> None:
    """Listen to how opening files ends."""
    bpy.app.handlers.load_post_fail.append(_failed)
    bpy.app.handlers.load_post.append(_opened)


def unregister() -> None:
    """Stop listening."""
    bpy.app.handlers.load_post.remove(_opened)
    bpy.app.handlers.load_post_fail.remove(_failed)
    _unread.clear()
