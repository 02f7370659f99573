# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree of a rendered frame: the scene's if it fits the frame, else a new one.

A bake calls Blender's render within a render. A scene has one render, so the bake uses a copy of the scene, and only
Blender's main thread, where renders run without a window and from scripts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy

from ...patchnet_addon.codes.coded_octree import CodedOctree
from ...patchnet_addon.network.weights import load_weights
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import PatchNetError, SceneError, StoppedError
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.runtime.stage_clock import StageClock
from ...patchnet_addon.tracing.camera import Camera
from ..pipeline.lit_octree import OctreeOverrides, build_lit_octree, cameras_text
from ..pipeline.stages import encode
from ..pipeline.voxels_key import surface_key, voxels_key
from ..scene.track import track_cameras, track_frames, track_key
from ..scene_access.frames import values_of_graph
from ..scene_access.main_thread import in_main_thread
from ..scene_access.own import quiet
from ..scene_access.temporary import scene_copy
from ..schema.values import GLOSS_AUTO, GLOSS_CAMERA, LIGHT, OCTREE, SEEN_CELLS
from ..session import results
from ..session.job_voxels import STAGES
from ..session.keep import keep
from ..session.octree_cache import found_on_disk, limit_bytes, result_or_kept
from ..session.scene_result import VOXELS, SceneResult
from ..session.scene_session import session_of
from ..session.staleness import look_again
from ..settings.job_settings import JobSettings, recorded
from ..state.digest import composed
from ..state.scene_state import scene_state

# A bake for each place of the camera would take minutes a frame, and cannot run in a window.
_GLOSS = (
    "Gloss is shown as seen from the camera's place during the bake: bake again for the current place, or choose "
    "Gloss: From Above"
)
_LAYER = (
    "View layer '{other}' shows other objects than '{own}', but is rendered with the voxels of '{own}': render without "
    "a window for voxels of its own"
)
_ONE_CAMERA = (
    "Voxels are fine only for the camera of one frame: tick All Frames in the panel Octree and press Preview Selection"
)
_AS_IT_WAS = "Until then, outdated voxels are shown"
_BUTTON = "Press Preview Selection in the tab PatchNet of the 3D viewport's sidebar (N), then render again"


def octree_of_frame(
    depsgraph: bpy.types.Depsgraph,
    camera: Camera,
    settings: JobSettings,
    warn: Callable[[str], None],
    *,
    animation: bool,
) -> Steps[tuple[Octree, CodedOctree | None]]:
    """Lit octree of a render's graph at its frame, with its codes if the settings want them for renders.

    camera: of the frame, which an automatic depth is fitted to, or to the cameras of all frames if only they move.
    warn: takes sentences about assumptions and lost input. animation: other frames follow. Raises PatchNetError.
    """
    scene = depsgraph.scene.original
    still = _stands_still(scene)
    if animation or settings.surface.track:  # frames made alone would have other reflections
        gloss, one_view = settings.light.gloss, still and not settings.surface.track
        settings = settings.changed(from_camera=gloss == GLOSS_CAMERA or (gloss == GLOSS_AUTO and one_view))
        if settings.surface.is_fitted and not still and in_main_thread() and scene_state(scene).frame is None:
            settings = settings.changed(track=True)
    result = yield from _result_of_frame(_Frame(depsgraph, scene, camera, settings, warn, animation, still))
    if result.coded is not None or settings.view.render_samples is not None:
        return result.octree, result.coded
    coded, _ = yield from encode(result.octree, load_weights(settings.network.weights), settings.network)
    if results.result_of(scene) is result:
        keep(scene, replace(result, coded=coded), "codes")
    return result.octree, coded


@dataclass(frozen=True, eq=False)
class _Frame:
    """Frame to render; see `octree_of_frame`. still: the camera has one place in all frames."""

    depsgraph: bpy.types.Depsgraph
    scene: bpy.types.Scene
    camera: Camera
    settings: JobSettings
    warn: Callable[[str], None]
    animation: bool
    still: bool

    @property
    def can_bake(self) -> bool:
        """Return whether Cycles can bake: it needs the main thread."""
        return not self.settings.light.is_baked or in_main_thread()

    @property
    def moves(self) -> bool:
        """Return whether its automatic depth depends on a camera that moves between frames."""
        return self.animation and not self.still and self.settings.surface.is_fitted


def _result_of_frame(frame: _Frame) -> Steps[SceneResult]:
    """Result that fits a frame: of the scene, of the last frame, of the cache folder, or a new one."""
    scene, session, there = frame.scene, session_of(frame.scene), result_or_kept(frame.scene)
    if there is not None:
        look_again(there, scene)
    fits = there is not None and (not there.stale or there.is_stale_by_gloss_alone) and _is_as_set(frame, there)
    kept = _with_its_gloss(frame, there) if there is not None and fits else None
    if kept is not None and not _serves_cameras(frame, kept):
        if frame.can_bake:
            kept = None
        else:
            frame.warn(_ONE_CAMERA)
    state, layer = kept.state if kept is not None else None, frame.depsgraph.view_layer.name
    other_layer = state is not None and not state.fits_layer(scene, layer)
    if state is not None and other_layer:
        if frame.can_bake:
            kept = None  # the panel keeps it
        else:
            frame.warn(_LAYER.format(own=state.layer, other=layer))
    here = kept is not None and kept.octree.provenance.get("frame") == scene.frame_current
    if kept is not None and ((here and not frame.animation) or (state is not None and state.frame is None)):
        return kept
    key = surface = ""
    # Without a key no later frame can be compared, nor one of another process.
    other = frame.animation or kept is not None or other_layer or session.made_frame is not None
    if other or (bpy.app.background and limit_bytes() > 0):
        yield Progress(0, 1, "Looking at the scene")
        key = surface = surface_key(frame.depsgraph, frame.settings)
        if frame.moves and not frame.settings.surface.track:
            key += cameras_text([frame.camera])
    if kept is not None and here:
        kept.frame_key = key
    for known in (kept, session.made_frame):
        if known is not None and key and known.frame_key == key:
            return known
    session.made_frame = None  # frees memory for the next one
    own_key = _key_of_voxels(frame, surface) if surface else ""
    found = _on_disk(frame, own_key) if surface else None
    if found is not None:
        found.frame_key, session.made_frame = key, found
        return found
    there = results.result_of(scene)
    made = yield from _made(frame, there)
    if made is not there:
        if not key and made.state is not None and made.state.frame is not None:  # of later frames as well, perhaps
            key = surface_key(frame.depsgraph, frame.settings)
        made.made_by[VOXELS] = own_key
        if key:
            made.frame_key, session.made_frame = key, made
        if not fits:
            keep(scene, made, "octree", "light")
    return made


def _is_as_set(frame: _Frame, result: SceneResult) -> bool:
    """Return whether the scene has the settings that it had; in a window they count from Preview Selection on."""
    if not bpy.app.background:
        return True
    now = frame.scene.patchnet
    same = all(result.made_with.get(stage) in (None, recorded(now, stage)) for stage in (OCTREE, LIGHT))
    if not (same and now.track):
        return same
    return result.made_by.get("track") in (None, track_key(frame.scene, frame.settings.surface.fitted_track))


def _with_its_gloss(frame: _Frame, kept: SceneResult) -> SceneResult | None:
    """Result, with a warning if its gloss is of another view; None if it has to be baked again."""
    of_one_view = frame.animation and not frame.still and _is_gloss_of_one_view(kept)
    if of_one_view and in_main_thread() and not frame.settings.light.from_camera:
        return None  # else its gloss would differ from frames that are baked now
    if of_one_view or kept.stale:
        frame.warn(_GLOSS)
    return kept


def _on_disk(frame: _Frame, key: str) -> SceneResult | None:
    """Octree of the cache folder that the frame's settings made of what its graph shows; none in a window.

    key: of the frame's voxels.
    """
    if not bpy.app.background:
        return None
    scene, settings = frame.scene, frame.settings
    with quiet(), values_of_graph(frame.depsgraph):
        found = found_on_disk(scene, key)
        if found is not None:  # with settings and cameras
            return found
        found = found_on_disk(scene)
    if found is None or (_is_gloss_of_one_view(found) and not frame.still):
        return None
    same = all(found.made_by.get(stage) == settings.key(stage) for stage in STAGES)
    same = same and found.made_by.get("track") == track_key(scene, settings.surface.fitted_track)
    return found if same and _serves_cameras(frame, found) else None


def _key_of_voxels(frame: _Frame, surface: str) -> str:
    """`voxels_key` of a frame; surface: its `surface_key`."""
    return voxels_key(frame.depsgraph, frame.settings, surface, _key_of_cameras(frame))


def _key_of_cameras(frame: _Frame) -> str:
    """As `cameras_key` of a job with the frame's settings."""
    settings = frame.settings
    fits = settings.surface.is_fitted or (settings.light.is_baked and settings.light.cells == SEEN_CELLS)
    return composed(cameras_text(_fitted_to(frame))) if fits else ""


def _stands_still(scene: bpy.types.Scene) -> bool:
    """Return whether one camera has one place in all frames, so that its gloss is the same."""
    item = scene.camera
    moves = item is None or any(marker.camera for marker in scene.timeline_markers)
    while item is not None and not moves:
        moves = item.animation_data is not None or len(item.constraints) > 0
        item = item.parent
    return not moves


def _serves_cameras(frame: _Frame, result: SceneResult) -> bool:
    """Return whether voxels are not those of one camera, where it moves."""
    return not frame.moves or result.layout is None or bool(result.made_with.get(OCTREE, {}).get("track"))


def _is_gloss_of_one_view(result: SceneResult) -> bool:
    """Return whether the gloss is of one camera."""
    return result.state is not None and bool(result.state.gloss_from)


def _made(frame: _Frame, there: SceneResult | None) -> Steps[SceneResult]:
    """Result of a render's graph; if none can be made, `there` with a warning."""
    if not frame.can_bake:
        why = "there are no voxels yet" if there is None else "the scene changed since it was voxelized and lit"
        error: PatchNetError = SceneError(f"{_BUTTON}: {why}, and Cycles cannot bake while a window renders")
    else:
        try:
            return (yield from _compute(frame))
        except StoppedError:
            raise
        except PatchNetError as problem:
            error = problem
    if there is None:
        raise error
    frame.warn(f"{error}. {_AS_IT_WAS}")
    return there


def _compute(frame: _Frame) -> Steps[SceneResult]:
    scene, settings = frame.scene, frame.settings
    weights = load_weights(settings.network.weights) if settings.view.render_samples is None else None
    overrides = OctreeOverrides(
        cameras=lambda: _fitted_to(frame),
        depsgraph=frame.depsgraph,
        baking=lambda: _bake_context(scene, frame.depsgraph, settings),
        provenance={"scene": scene.name, "frame": scene.frame_current},  # not those of the copy that bakes
    )
    made = yield from build_lit_octree(bpy.context, settings, StageClock(), overrides)
    coded = None if weights is None else (yield from encode(made.octree, weights, settings.network))[0]
    for warning in made.warnings:
        frame.warn(warning)
    made_by = {stage: settings.key(stage) for stage in STAGES} | {
        "cameras": _key_of_cameras(frame),
        "seen": cameras_text([frame.camera]),
        "track": track_key(scene, settings.surface.fitted_track),
    }
    return SceneResult(
        made.octree,
        settings.surface.scope,
        made.layout,
        settings.light.kind,
        coded,
        made_by=made_by,
        state=made.state,
    )


def _fitted_to(frame: _Frame) -> list[Camera]:
    """Cameras that an automatic depth is fitted to: of all frames with All Frames, in the same order at each."""
    scene, surface = frame.scene, frame.settings.surface
    if not (surface.is_fitted and surface.track and in_main_thread()):
        return [frame.camera]
    beyond = scene.frame_current not in track_frames(scene, surface.track_frames)
    return track_cameras(scene, (), (0, 0), surface.track_frames) + ([frame.camera] if beyond else [])


@contextmanager
def _bake_context(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, settings: JobSettings) -> Iterator[None]:
    """Context with a copy of the scene at the frame of the graph, if Cycles bakes."""
    if not settings.light.is_baked:
        yield
        return
    with quiet(), values_of_graph(depsgraph), scene_copy(scene) as copy:
        layer = copy.view_layers[depsgraph.view_layer.name]
        with bpy.context.temp_override(scene=copy, view_layer=layer):
            yield
