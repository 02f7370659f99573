# SPDX-License-Identifier: GPL-3.0-or-later
"""Built-in scenes of the command line (courtyard, room), named in the place of a file."""

from __future__ import annotations

from .scene_argument import open_given

DEMO, ROOM, GLOSSY_ROOM = "demo", "room", "glossy-room"
OWN = (DEMO, ROOM, GLOSSY_ROOM)


def open_or_build(scene: str | None) -> None:
    """Open the scene's file if one is named, or build one of the project's own scenes in an empty file."""
    import bpy

    from ...operators.demo_scene import build_courtyard, build_glossy_room, build_room
    from .quiet import quiet_stdout

    builder = {DEMO: build_courtyard, ROOM: build_room, GLOSSY_ROOM: build_glossy_room}.get(scene or "")
    if scene is None or builder is None:
        open_given(scene)
        return
    with quiet_stdout():
        bpy.ops.wm.read_homefile(use_empty=True)
        builder(bpy.context.scene)
    bpy.context.scene.name = scene.capitalize()
