# SPDX-License-Identifier: GPL-3.0-or-later
"""Final render of one frame: octree, picture, passes, between which the user may stop it."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import bpy
import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import StoppedError
from ...patchnet_addon.runtime.eta import FramesEta, left_text
from ...patchnet_addon.runtime.log import event
from ...patchnet_addon.runtime.progress import Result, Steps
from ...patchnet_addon.runtime.worker import attended
from ...patchnet_addon.sampling.adaptive import AdaptivePicture
from ...patchnet_addon.sampling.importance import PixelRect
from ...patchnet_addon.sampling.registry import strategy
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.background import background
from ..importance.pixels import read_strokes
from ..properties import scene_settings
from ..properties.preferences import apply_preferences
from ..scene.cameras import focus_warnings
from ..scene_access.frames import values_of_graph
from ..schema.table import AUTO, CYCLES, VISIBLE
from ..session.scene_session import in_main_thread
from ..session.world_maps import awaited_background
from .frame_octree import octree_of_frame
from .passes import pass_pixels
from .render_camera import render_view

_begun: dict[int, tuple[int, FramesEta]] = {}  # by scene: the frame that comes next, and the time of all


@contextmanager
def rendered_frame(engine: bpy.types.RenderEngine, scene: bpy.types.Scene) -> Iterator[FramesEta | None]:
    """Time of the animation that the frame rendered in the block belongs to; None for one that is rendered alone.

    A frame that is not the next of the last one begins another animation.
    """
    if not engine.is_animation:
        yield None
        return
    original = scene.original
    key, frame = original.session_uid, original.frame_current
    expected, frames = _begun.pop(key, (None, None))
    if frames is None or expected != frame:
        frames = FramesEta(len(range(frame, original.frame_end + 1, original.frame_step)) or 1)
    frames.begin()
    yield frames
    frames.end()
    _begun.clear()  # of other scenes, which may be gone
    _begun[key] = frame + original.frame_step, frames


_SHOWN_S = 0.7  # between two looks at the unfinished picture


def render_frame(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render the graph's view layer into the engine's result.

    Raises StoppedError when the user stops, and PatchNetError.
    """
    apply_preferences(bpy.context)
    engine.warnings = ()
    scene = depsgraph.scene
    settings = scene_settings(scene.original)
    wanted = settings.view
    chosen = strategy(wanted.strategy)
    eye = engine.camera_override or (scene.camera and scene.camera.evaluated_get(depsgraph))
    camera, rect, kept = render_view(scene, eye, (engine.resolution_x, engine.resolution_y))
    strokes = None
    if wanted.importance is not None:  # what is missing is said before anything is made
        strokes = read_strokes(wanted.importance, VISIBLE, depsgraph)  # what was voxelized may not be selected now
    _mention_left_out(engine, scene, camera)
    making = octree_of_frame(depsgraph, camera, settings, partial(warn, engine), animation=engine.is_animation)
    with rendered_frame(engine, scene) as frames:
        octree, coded = pull(engine, making, 0.0, 0.3, frames)
        importance = None if strokes is None else partial(strokes.weights, octree.grid, rect=rect)
        world = pull(engine, _world(engine, depsgraph, camera, octree), 0.3, 0.3, frames)
        budget = wanted.budget if wanted.spp is None else None
        if wanted.render_side is None:
            picture = AdaptivePicture(octree, camera, chosen, coded, importance, wanted.unrefined, budget)
            refining = picture.refine(wanted.budget, spp=wanted.spp, refined=wanted.refined_samples)
        else:
            picture = AdaptivePicture(octree, camera, None, None, importance)
            refining = picture.sample_evenly(wanted.render_side)
        output = _Output(engine, depsgraph.view_layer.name, kept, picture, world)
        try:
            pull(engine, output.shown_meanwhile(picture.trace()), 0.3, 0.5, frames)
            _warn_of_unseen(engine, picture)
            pull(engine, output.shown_meanwhile(refining), 0.5, 1.0, frames)
        finally:  # a render that was stopped shows how far it came
            output.end()


def pull(
    engine: bpy.types.RenderEngine, steps: Steps[Result], start: float, end: float, frames: FramesEta | None = None
) -> Result:
    """Run steps to their end; they are the share of the frame's render from `start` to `end`.

    frames: of an animation, whose time stands before each step.
    Raises StoppedError, with the steps cleaned up, as soon as the user stops the render.
    """
    said = ""
    try:
        while True:
            with attended():  # so that a stop is heard while kernels compile
                report = next(steps)
            text = f"{report.label} {round(100 * report.fraction)} %" + (f", {report.note}" if report.note else "")
            if frames is not None:
                left = left_text(frames.see(replace(report, whole=None)).left_s)
                text = f"{frames.text}{', ' if left else ''}{left}: {text}"
            if text != said:  # in background Blender prints it
                said = text
                engine.update_stats("PatchNet", text)
                engine.update_progress(start + (end - start) * report.fraction)
            if engine.test_break():
                raise StoppedError("The render was stopped")
    except StopIteration as stop:
        return stop.value
    finally:
        steps.close()


class _Output:
    """Render's result while it is written."""

    def __init__(
        self,
        engine: bpy.types.RenderEngine,
        layer: str,
        kept: PixelRect,
        picture: AdaptivePicture,
        world: np.ndarray | None,
    ) -> None:
        self._engine, self._kept, self._picture, self._world = engine, kept, picture, world
        self._result = engine.begin_result(0, 0, kept.width, kept.height, layer=layer)
        self._shown = time.monotonic()

    def shown_meanwhile(self, steps: Steps[None]) -> Steps[None]:
        """Pass on the steps; now and then the picture that they work on is shown, where there is a window."""
        for report in steps:
            if not bpy.app.background and time.monotonic() - self._shown > _SHOWN_S:
                self._write()
                self._engine.update_result(self._result)
                self._shown = time.monotonic()
            yield report

    def end(self) -> None:
        """Hand the result over."""
        self._write()
        self._engine.end_result(self._result)

    def _write(self) -> None:
        pixels = pass_pixels(self._picture, self._world)
        for item in self._result.layers[0].passes:  # of each view, where there are several
            if item.name in pixels:
                item.rect.foreach_set(self._of_result(pixels[item.name]))

    def _of_result(self, pixels: np.ndarray) -> np.ndarray:
        """Values (N,) of the pixels (P, C) of the view that are the result's, without its margin."""
        camera, kept = self._picture.camera, self._kept
        picture = pixels.reshape(camera.height_px, camera.width_px, -1)
        rows, columns = slice(kept.bottom, kept.bottom + kept.height), slice(kept.left, kept.left + kept.width)
        return np.ascontiguousarray(picture[rows, columns]).ravel()


def _world(
    engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, camera: Camera, octree: Octree
) -> Steps[np.ndarray | None]:
    """What the camera sees behind all surfaces, see `combined`; black with a warning where nothing can find out."""
    baked = octree.provenance.get("light") == CYCLES
    if in_main_thread():
        with values_of_graph(depsgraph):
            seen = yield from background(depsgraph, camera, AUTO, baked=baked)
    else:
        seen = yield from awaited_background(depsgraph, camera, baked=baked)
    for warning in seen.warnings:
        warn(engine, warning)
    return seen.light


def _warn_of_unseen(engine: bpy.types.RenderEngine, picture: AdaptivePicture) -> None:
    """Say why the picture shows nothing or is black; its world is black behind what is meant to be seen, too."""
    from ...patchnet_addon.tracing.empty_view import why_unseen

    buffers = picture.buffers
    assert buffers is not None
    warning = why_unseen(picture.octree, picture.camera, buffers.hits, float(buffers.preview.max()))
    if warning is not None:
        warn(engine, warning)


def warn(engine: bpy.types.RenderEngine, text: str) -> None:
    """Report a warning in the status bar or on the terminal, in the log, and above the picture, where it stays."""
    engine.report({"WARNING"}, text)
    engine.warnings = dict.fromkeys((*engine.warnings, text))
    engine.error_set(". ".join(engine.warnings))
    event("warning", text, logging.WARNING)


def _mention_left_out(engine: bpy.types.RenderEngine, scene: bpy.types.Scene, camera: Camera) -> None:
    for text in focus_warnings(scene.original, [camera]):
        warn(engine, text)
    if scene.render.use_multiview:
        warn(engine, "PatchNet renders no stereo: all views show what the middle camera sees")
    if scene.render.use_motion_blur:
        warn(engine, "PatchNet renders no motion blur: turn it off, or leave it and have none")
