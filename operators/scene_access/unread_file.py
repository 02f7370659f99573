# SPDX-License-Identifier: GPL-3.0-or-later
"""Failed loading of a file, after which a batch job must not use the default scene instead.

`blender -b damaged.blend` prints one line and continues with an untitled scene.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ...patchnet_addon.runtime.errors import SceneError
from .window_state import Part

_unread = Part("unread_file", list[str])  # path of a file that failed to load, until another one is opened


def check_opened() -> None:
    """Raise SceneError in background if the file to open failed to load."""
    if bpy.app.background and _unread() and not bpy.data.filepath:
        raise SceneError(
            f"Scene file {_unread()[-1]} could not be opened and may be damaged: open another file, or a backup of it"
        )


@persistent
def _failed(path: str) -> None:
    _unread()[:] = [path]


@persistent
def _opened(_path: str) -> None:
    _unread().clear()


HANDLERS = (("load_post_fail", _failed), ("load_post", _opened))
