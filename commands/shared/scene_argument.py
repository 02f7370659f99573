# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene argument of a command: a file that it opens, or the open one in `blender -b FILE --command patchnet`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...patchnet_addon.runtime.errors import SceneError

NO_SCENE = "There is no scene: name its file, or open one with `blender -b FILE --command patchnet`"


def add_scene(parser: argparse.ArgumentParser, text: str, kind: Callable[[str], Any] = Path) -> None:
    """Add the argument SCENE, which may be left out where a file is open."""
    parser.add_argument("scene", type=kind, nargs="?", help=f"{text}; in Blender, the open file if it is left out")


def scene_path(scene: Path | str | None) -> Path:
    """File of the scene, for its name; raises SceneError if none is named and none is open."""
    import bpy

    from ...operators.scene_access.unread_file import check_opened

    if scene is None and not bpy.data.filepath:
        check_opened()
        raise SceneError(NO_SCENE)
    return Path(bpy.data.filepath if scene is None else scene)


def open_given(scene: Path | str | None) -> None:
    """Open the scene if a file is named, else keep what is open; raises SceneError."""
    from ...operators.scene.files import open_scene
    from .quiet import quiet_stdout

    path = scene_path(scene)
    if scene is not None:
        with quiet_stdout():
            open_scene(path)


def opened_file(scene: Path | None) -> Path | None:
    """Return the .blend file that was opened just now; what was open before may have been changed by a script since."""
    from ...operators.scene.files import is_blend

    return scene if scene is not None and is_blend(scene) else None
