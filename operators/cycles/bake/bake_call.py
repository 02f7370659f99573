# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake of one object by Blender, by one call or as a job beside a responsive window.

Python cannot stop a call. In a window, the bake is a job of Blender (`window_job`): steps wait for it, and Esc stops
it within a moment, also between two objects while Cycles reads the scene.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy

from ....patchnet_addon.runtime.errors import SceneError, StoppedError
from ....patchnet_addon.runtime.progress import Progress, Steps
from ...scene_access.window_job import BAKE, CANCEL, COMPLETE, INTERRUPTED, as_job, editors_keep_images
from .surfel_mesh import TEXEL_LAYER

_STOPPED = "Cycles stopped baking the light of the scene: start the bake again to resume it"
_DIFFUSE = {"DIRECT", "INDIRECT", "DIFFUSE", "EMIT"}
_GLOSSY = {"GLOSSY", "TRANSMISSION"}
_ARGUMENTS: dict[str, Any] = {
    "margin": 0,
    "use_clear": True,
    "use_selected_to_active": False,
    "target": "IMAGE_TEXTURES",
    "save_mode": "INTERNAL",
    "uv_layer": TEXEL_LAYER,
}


@dataclass(frozen=True)
class BakeTarget:
    """Object to bake into the active images of its materials, and the scene copy and view layer that light it.

    gloss: bake reflected and transmitted light, too. colors: bake diffuse colors instead of light.
    """

    scene: bpy.types.Scene
    layer: bpy.types.ViewLayer
    item: bpy.types.Object
    image: bpy.types.Image
    gloss: bool = False
    colors: bool = False


def bake_now(context: bpy.types.Context, target: BakeTarget) -> None:
    """Bake; raises SceneError."""
    if "FINISHED" not in _called(context, target, lambda how: bpy.ops.object.bake(**how)):
        raise StoppedError(_STOPPED)


def bake_as_job(context: bpy.types.Context, target: BakeTarget, at: Progress) -> Steps[None]:
    """Bake as `bake_now`, as a job: reports `at` as waiting until the job ends; raises StoppedError after Esc.

    Closing these steps stops the job.
    """
    with editors_keep_images(context.window_manager) as give_back:

        def look() -> Progress:
            give_back()
            return at

        ended = {INTERRUPTED: 0.0}
        while INTERRUPTED in ended and COMPLETE not in ended:
            ended = yield from as_job(BAKE, target.scene, lambda: _called(context, target, _start), look)
    if CANCEL in ended:
        raise StoppedError(_STOPPED)
    if COMPLETE not in ended or not target.image.is_dirty:
        raise SceneError("Cycles cannot bake the light of the scene: Blender's terminal says why")


def _passes(target: BakeTarget) -> dict[str, Any]:
    if target.colors:
        return {"type": "DIFFUSE", "pass_filter": {"COLOR"}}
    return {"type": "COMBINED", "pass_filter": _DIFFUSE | _GLOSSY if target.gloss else _DIFFUSE}


def _start(how: dict[str, Any]) -> set[str]:
    return bpy.ops.patchnet.bake_beside_window("INVOKE_DEFAULT", OBJECT_OT_bake=how)


def _called(context: bpy.types.Context, target: BakeTarget, bake: Callable[[dict[str, Any]], set[str]]) -> set[str]:
    item = target.item
    override = {"scene": target.scene, "view_layer": target.layer}
    override |= {"active_object": item, "object": item, "selected_objects": [item]}
    try:
        with context.temp_override(**override):
            return bake(_ARGUMENTS | _passes(target))
    except RuntimeError as cause:
        reason = str(cause).strip().removeprefix("Error: ")
        raise SceneError(f"Cycles cannot bake the light of the scene ({reason})") from cause
