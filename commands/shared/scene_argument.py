# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene argument of a command: a file, or the open one in `blender -b FILE --command patchnet`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...patchnet_addon.runtime.errors import SceneError

OWN = ("demo", "room", "glossy-room")
"""Built-in scenes, given by name instead of a file."""
NO_SCENE = "There is no scene: name its file, or open one with `blender -b FILE --command patchnet`"


def add_scene(parser: argparse.ArgumentParser, text: str, kind: Callable[[str], Any] = Path) -> None:
    """Add the argument SCENE, optional in Blender."""
    parser.add_argument("scene", type=kind, nargs="?", help=f"{text}; in Blender, the open file if it is left out")


def scene_path(scene: Path | str | None) -> Path:
    """Path of the scene; raises SceneError if no file is given or open."""
    import bpy

    from ...operators.scene_access.unread_file import check_opened

    if scene is None and not bpy.data.filepath:
        check_opened()
        raise SceneError(NO_SCENE)
    return Path(bpy.data.filepath if scene is None else scene)


def open_given(scene: Path | str | None) -> None:
    """Open the scene if a file is given, else keep the open one; raises SceneError."""
    from ...operators.scene.files import open_scene
    from .quiet import quiet_stdout

    path = scene_path(scene)
    if scene is not None:
        with quiet_stdout():
            open_scene(path)


def open_or_build(scene: str | None) -> None:
    """Open the scene's file, or build one of OWN in an empty file."""
    import bpy

    from ...operators.demo_scene import build_courtyard, build_glossy_room, build_room
    from .quiet import quiet_stdout

    builder = dict(zip(OWN, (build_courtyard, build_room, build_glossy_room), strict=True)).get(scene or "")
    if scene is None or builder is None:
        open_given(scene)
        return
    with quiet_stdout():
        bpy.ops.wm.read_homefile(use_empty=True)
        builder(bpy.context.scene)
    bpy.context.scene.name = scene.capitalize()
