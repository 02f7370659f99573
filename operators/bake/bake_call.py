# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's bake of one object: as one call, or beside a window that stays alive.

A call returns when the bake has ended; nothing of Python's can stop it. From a window that an operator works in, the
bake runs as a job of Blender's own: steps wait for it, and Esc stops it within a moment, while Cycles reads the scene
too, between two objects.
"""

from __future__ import annotations

from typing import Any

import bpy

from ...patchnet_addon.errors import SceneError, StoppedError
from ...patchnet_addon.progress import Progress, Steps
from ..window_job import BAKE, as_job
from .page_mesh import CHART_LAYER

_STOPPED = "Cycles stopped baking the light of the scene: start it again, it goes on where it was"
_ARGUMENTS: dict[str, Any] = {
    "type": "COMBINED",
    "pass_filter": {"DIRECT", "INDIRECT", "DIFFUSE", "EMIT"},
    "margin": 0,
    "use_clear": True,
    "use_selected_to_active": False,
    "target": "IMAGE_TEXTURES",
    "save_mode": "INTERNAL",
    "uv_layer": CHART_LAYER,
}


def run(context: bpy.types.Context, target: bpy.types.Object) -> None:
    """Bake `target` into the active images of its materials. Raises SceneError."""
    if "FINISHED" not in _called(context, target, "EXEC_DEFAULT"):
        raise StoppedError(_STOPPED)


def run_as_job(
    context: bpy.types.Context, target: bpy.types.Object, image: bpy.types.Image, at: Progress
) -> Steps[None]:
    """As `run`, in a window: reports `at` as waiting until the job has ended. Raises StoppedError after Esc.

    Closing these steps does not stop the job: what it works on must stay until `when_job_ended`.
    """
    end = yield from as_job(BAKE, lambda: _called(context, target, "INVOKE_DEFAULT"), lambda: at)
    if end.cancelled:
        raise StoppedError(_STOPPED)
    if not end.completed or not image.is_dirty:
        raise SceneError("Cycles cannot bake the light of the scene: Blender's status bar or terminal says why")


def _called(context: bpy.types.Context, target: bpy.types.Object, how: str) -> set[str]:
    override = {"active_object": target, "object": target, "selected_objects": [target]}
    try:
        with context.temp_override(**override):
            result: set[str] = bpy.ops.object.bake(how, **_ARGUMENTS)
    except RuntimeError as cause:
        reason = str(cause).strip().removeprefix("Error: ")
        raise SceneError(f"Cycles cannot bake the light of the scene ({reason})") from cause
    return result
