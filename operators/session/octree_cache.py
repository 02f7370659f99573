# SPDX-License-Identifier: GPL-3.0-or-later
"""Disk cache of finished octrees and codes, which restores them when a file is opened.

The key of an entry is the state of the scene that it was made of, whatever the name of the file; where that may
change from frame to frame, or a command has settings of its own, it is all that voxels depend on (`voxels_key`). In
background, the cache is searched when a job needs voxels; in a window, shortly after a file is opened.
"""

from __future__ import annotations

import logging
import os
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.handlers import persistent

from ...patchnet_addon.codes.octree_cache import CachedOctree, OctreeCache
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.bounds import KEPT_GIB
from ...patchnet_addon.runtime.cache_folder import OCTREES, user_cache_folder
from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ...patchnet_addon.runtime.progress import Steps, drain
from ..properties.preferences import apply_preferences, preferences
from ..scene_access.window_state import Part
from . import results
from .scene_result import VOXELS, SceneResult
from .scene_session import session_of
from .staleness import look_again

if TYPE_CHECKING:
    from ..settings.groups import NetworkSettings
    from ..state.scene_state import SceneState

VARIABLE = "PATCHNET_KEEP"  # GiB, in the place of the preference
_NOTES = ("scope", "light", "seconds", "encoder", "made_with", "made_by", "notes")  # fields of results
_AFTER_OPENING_S = 0.1
_LOOK_S = 0.1  # between two looks at an entry that is being written
_writing = Part("cache_entries", list[Steps[bool]])  # one after the other: an older one never replaces a newer one


def keep_on_disk(scene: bpy.types.Scene, result: SceneResult, *, apart: bool = False) -> None:
    """Write a scene's result into the cache folder, in a window beside it; none whose light is unfinished.

    apart: beside the result of the scene's own settings, as that of a command with settings of its own.
    """
    state, made = result.state, result.made_by.get(VOXELS, "")
    if state is None or result.unfinished or limit_bytes() <= 0:
        return
    key = made if made and (apart or state.frame is not None) else _key(state)
    saving = computed(OctreeCache.save, _cache(), key, _entry(result, scene), lasts=True)
    if bpy.app.background:
        drain(saving)
        return
    _writing().append(saving)
    if not bpy.app.timers.is_registered(_write):
        bpy.app.timers.register(_write, persistent=True)


def restore(scene: bpy.types.Scene) -> bool:
    """Restore the result of a scene from the cache folder; return whether one fits."""
    result = None if results.result_of(scene) is not None else found_on_disk(scene)
    if result is None:
        return False
    results.put(scene, result)
    look_again(result, scene)  # for the camera of the baked gloss; all else is equal
    return True


def found_on_disk(scene: bpy.types.Scene, key: str = "", network: NetworkSettings | None = None) -> SceneResult | None:
    """Result in the cache folder that fits a scene as it is now, or None.

    key: `voxels_key` of the result that is wanted; else the one that was last made, whatever its settings. network: of
    its codes, by default the scene's.
    """
    if not may_be_on_disk(scene):
        return None
    from ...patchnet_addon.network.weights import load_weights
    from ..properties.job import scene_settings
    from ..state.scene_state import scene_state

    state = scene_state(scene)
    found = _cache().load(key or _key(state), load_weights((network or scene_settings(scene).network).weights))
    if found is None:
        return None
    if (names := found.notes.get("chosen")) is not None:  # the selection may have changed
        chosen = frozenset(item.session_uid for item in scene.objects if item.name_full in names)
        state = scene_state(scene, chosen=chosen)
    return _result(found, state)


def may_be_on_disk(scene: bpy.types.Scene) -> bool:
    """Return whether the cache folder has a result of a scene with as many meshes, without hashing the scene."""
    if limit_bytes() <= 0:
        return False
    apply_preferences(bpy.context)
    fingerprint = _fingerprint(scene)
    return any(notes.get("fingerprint") == fingerprint for notes in _cache().notes().values())


def result_or_kept(scene: bpy.types.Scene) -> SceneResult | None:
    """Return the result of `scene`, in background from the cache folder too."""
    session = session_of(scene)
    if session.result is None and bpy.app.background and not session.looked:
        session.looked = True
        with suppress(PatchNetError):  # such as missing weights, which the job reports
            restore(scene)
    return session.result


def limit_bytes() -> int:
    """Size limit of the cache in bytes."""
    text = os.environ.get(VARIABLE, "")
    with suppress(SettingError):
        return int(KEPT_GIB.read(text, VARIABLE) * 2**30)
    return int(preferences(bpy.context).kept_gib * 2**30)


def _cache() -> OctreeCache:
    return OctreeCache(user_cache_folder() / OCTREES, limit_bytes())


def _write() -> float | None:
    """Look at the entry that is being written, and begin the next one after it."""
    while waiting := _writing():
        try:
            next(waiting[0])
            return _LOOK_S
        except StopIteration:
            pass
        except PatchNetError as error:
            logging.getLogger("patchnet").warning("The octree cannot be cached for the next session: %s", error)
        waiting.pop(0)
    return None


def _key(state: SceneState) -> str:
    """Key of an octree by its scene alone, whose entry holds the settings."""
    from ..pipeline.voxels_key import code_hash

    return state.identity(code_hash(), bpy.app.version_string)


def _fingerprint(scene: bpy.types.Scene) -> list[Any]:
    """Cheap fingerprint that tells most scenes apart."""
    meshes = [item.data for item in scene.objects if item.type == "MESH"]
    return [len(meshes), len(set(meshes))]


def _entry(result: SceneResult, scene: bpy.types.Scene) -> CachedOctree:
    state, chosen = result.state, None  # names of the objects that have voxels, None for all
    if state is not None and state.chosen is not None:
        chosen = [item.name_full for item in scene.objects if item.session_uid in state.chosen]
    notes = {name: getattr(results.without_view(result), name) for name in _NOTES} | {
        "fingerprint": _fingerprint(scene),
        "chosen": chosen,
        "gloss_from": "" if state is None else state.gloss_from,
    }
    return CachedOctree(result.octree, result.coded, result.layout, notes)


def _result(found: CachedOctree, state: SceneState) -> SceneResult:
    kept = {name: found.notes[name] for name in _NOTES}
    kept["notes"] = {step: tuple(texts) for step, texts in kept["notes"].items()}
    state = replace(state, gloss_from=found.notes["gloss_from"])
    return SceneResult(found.octree, layout=found.layout, coded=found.coded, state=state, **kept)


@persistent
def _on_load_post(*_: object) -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_restore_shown):
        bpy.app.timers.register(_restore_shown, first_interval=_AFTER_OPENING_S)


def _restore_shown() -> None:
    """Restore results of the scenes in windows."""
    for scene in {window.scene for window in bpy.context.window_manager.windows}:
        with suppress(PatchNetError):
            restore(scene)
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            area.tag_redraw()


HANDLERS = (("load_post", _on_load_post),)
TIMERS = (_restore_shown, _write)


def register() -> None:
    """Restore results of the open file."""
    _on_load_post()
