# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree of a rendered frame: the one that is there if it fits the frame, else a new one.

A bake calls Blender's own render from within ours. A scene has one render, so it bakes in a copy of the scene, and only
in Blender's main thread, which is where renders run without a window and from scripts.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from ..pipeline.stages import build, choose_grid, encode, lit, load_network
from ..scene import read_scene
from ..scene_access.quiet import quiet
from ..scene_access.temporary import scene_copy
from ..session import results
from ..session.kept_results import result_or_kept
from ..session.staleness import look_again
from ..settings.job_settings import CYCLES, JobSettings
from ..state.scene_state import scene_state
from .surface_key import may_change, surface_key

_BUTTON = "press Preview Selection in the tab PatchNet of the 3D viewport's sidebar (N), then render again"


@dataclass(frozen=True)
class _Known:
    """Result that was rendered from, and the key of the scene that it shows."""

    result: results.SceneResult
    key: str


_kept: dict[int, _Known] = {}  # by scene: what `results` keeps, once its key was asked for
_made: dict[int, _Known] = {}  # by scene: what was made for the last frame that needed its own


def forget_frames(*_: object) -> None:
    """Free what was made for frames of an animation."""
    _kept.clear()
    _made.clear()


def all_results() -> list[results.SceneResult]:
    """Results that are kept for frames."""
    return [known.result for known in (*_kept.values(), *_made.values())]


def octree_of_frame(
    depsgraph: bpy.types.Depsgraph,
    camera: Camera,
    settings: JobSettings,
    warn: Callable[[str], None],
    *,
    animation: bool,
) -> Steps[CodedOctree]:
    """Lit and coded octree of a render's graph at its frame; `camera` sees it if the depth is to be found.

    warn: takes sentences about what had to be assumed or left out where one is made.
    animation: other frames follow. Raises PatchNetError.
    """
    scene = depsgraph.scene.original
    number, result = scene.session_uid, result_or_kept(scene)
    if result is not None:
        look_again(result, scene)
    kept = None if result is None or result.stale else result
    here = kept is not None and kept.octree.provenance.get("frame") == scene.frame_current
    if kept is not None and ((here and not animation) or not may_change(scene)):
        return (yield from _coded(scene, kept, settings))
    key = ""
    if animation or kept is not None or number in _made:  # else nothing is there to compare with, nor will be
        yield Progress(0, 1, "Looking at the scene")
        key = surface_key(depsgraph, settings)
    if kept is not None and here:
        _kept[number] = _Known(kept, key)
    for known in (_kept.get(number), _made.get(number)):
        if known is not None and known.key == key and (known.result is kept or known is _made.get(number)):
            return (yield from _coded(scene, known.result, settings))
    _made.pop(number, None)  # before the next one takes memory
    result = yield from _compute(depsgraph, camera, settings, warn, nothing_there=results.result_of(scene) is None)
    if key:
        _made[number] = _Known(result, key)
    if kept is None:
        results.keep(scene, result, "octree", "light")
    return (yield from _coded(scene, result, settings))


def _coded(scene: bpy.types.Scene, result: results.SceneResult, settings: JobSettings) -> Steps[CodedOctree]:
    """Codes of a result, which are kept with it where it is kept."""
    if result.coded is None:
        coded = yield from encode(result.octree, load_network(settings.weights))
        if results.result_of(scene) is result:
            results.keep(scene, replace(result, coded=coded), "codes")
        return coded
    return result.coded


def _compute(
    depsgraph: bpy.types.Depsgraph,
    camera: Camera,
    settings: JobSettings,
    warn: Callable[[str], None],
    *,
    nothing_there: bool,
) -> Steps[results.SceneResult]:
    from ...patchnet_addon.lightmap.page_cache import KeptPages

    if settings.light == CYCLES and threading.current_thread() is not threading.main_thread():
        why = "There are no voxels yet" if nothing_there else "The scene is not what was voxelized and lit"
        raise SceneError(f"{why}, and Cycles cannot bake while a window renders: {_BUTTON}")
    yield Progress(0, 1, "Reading the scene")
    scene = depsgraph.scene.original
    weights = load_network(settings.weights)
    source, state = read_scene(depsgraph, settings.scope), scene_state(scene, depsgraph.view_layer.name)
    choice = yield from choose_grid(source, [camera], settings)
    with _bake_context(scene, depsgraph, settings), KeptPages() as pages:
        shade, assumed = yield from lit(bpy.context, source, choice.grid, choice.layout, settings, pages, depsgraph)
        octree = yield from build(source, choice.grid, shade, settings, settings.light, choice.layout, state)
    octree = replace(octree, provenance=octree.provenance | {"scene": scene.name, "frame": scene.frame_current})
    coded = yield from encode(octree, weights)
    for warning in (*source.warnings, *choice.warnings, *assumed):
        warn(warning)
    return results.SceneResult(octree, settings.scope, choice.layout, settings.light, coded, state=state)


@contextmanager
def _bake_context(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, settings: JobSettings) -> Iterator[None]:
    """Let the context show a copy of the scene if Cycles bakes."""
    if settings.light != CYCLES:
        yield
        return
    with quiet(), scene_copy(scene) as copy:
        layer = copy.view_layers[depsgraph.view_layer.name]
        with bpy.context.temp_override(scene=copy, view_layer=layer):
            yield
