# SPDX-License-Identifier: GPL-3.0-or-later
"""Search over the scene's cameras, as Blender's fields that pick an object have it; several go with commas between."""

from __future__ import annotations

import bpy

from ...scene.cameras import ALL, AUTO, scene_cameras


def camera_candidates(_values: object, context: bpy.types.Context, text: str) -> list[tuple[str, str]]:
    """Candidates (value, what it is) for a text that is being typed: each camera, all of them, or views of the scene.

    After a comma, each camera that the text does not name yet is added to those that it names.
    """
    names = sorted(scene_cameras(context.scene))
    *before, _ = text.split(",")
    named = [name for name in map(str.strip, before) if name]
    if named:
        return [(", ".join([*named, name]), "One more camera") for name in names if name not in named]
    active = context.scene.camera
    cameras = [(name, "Active camera" if active is not None and active.name == name else "Camera") for name in names]
    several = [(ALL, "Every camera of the scene")] if len(names) > 1 else []
    return [*cameras, *several, (AUTO, "Three views of the scene, inside where it is a room")]
