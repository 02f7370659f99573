# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the result of a step: for its scene, in the cache folder, and beside a map of the world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..scene.track import track_key
from ..settings.job_settings import recorded
from ..state.watch import changes_meanwhile
from . import results
from .octree_cache import keep_on_disk
from .scene_result import SceneResult
from .world_maps import ask_for_map

if TYPE_CHECKING:
    from ..settings.job_settings import JobSettings

_ENGINE = "PATCHNET"  # as in `render_engine/engine.py`


def keep(scene: bpy.types.Scene, result: SceneResult, *steps: str, settings: JobSettings | None = None) -> None:
    """Replace the result of `scene`. `steps`: done now with `settings`, of "octree", "light", "codes", "view"."""
    if settings is not None:
        result.made_by = result.made_by | {step: settings.key(step) for step in steps if step != "view"}
        if "octree" in steps:
            result.made_by["track"] = track_key(scene, settings.surface.fitted_track)
    result.made_with = result.made_with | {step: recorded(scene.patchnet, step) for step in steps}
    if {"octree", "light"} & set(steps):
        for change in changes_meanwhile():
            result.see(change)
    results.put(scene, result)
    if {"octree", "light", "codes"} & set(steps):
        keep_on_disk(scene, result)
        if scene.render.engine == _ENGINE:  # a render in the window may come next
            ask_for_map(scene)
