# SPDX-License-Identifier: GPL-3.0-or-later
"""Final render of one frame: octree, picture and passes; the user may stop it."""

from __future__ import annotations

import logging
import time
from functools import partial

import bpy
import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.runtime.errors import StoppedError
from ...patchnet_addon.runtime.log import event
from ...patchnet_addon.runtime.progress import Result, Steps
from ...patchnet_addon.runtime.worker import attended
from ...patchnet_addon.sampling.adaptive import AdaptivePicture
from ...patchnet_addon.sampling.importance import PixelRect
from ...patchnet_addon.sampling.registry import strategy
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.background import background
from ..importance.pixels import read_strokes
from ..properties.job import scene_settings
from ..properties.preferences import apply_preferences
from ..scene.cameras import focus_warnings
from ..scene_access.frames import values_of_graph
from ..schema.values import AUTO, CYCLES, VISIBLE
from ..session.scene_session import in_main_thread
from ..session.world_maps import awaited_background
from ..settings.groups import samples_side
from .frame_octree import octree_of_frame
from .passes import pass_pixels
from .render_camera import render_view

_SHOWN_S = 0.7  # between two updates of the unfinished picture


def render_frame(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render the graph's view layer into the engine's result.

    Raises StoppedError when the user stops, and PatchNetError.
    """
    apply_preferences(bpy.context)
    from ...patchnet_addon.tracing.empty_view import why_unseen

    engine.warnings = ()
    scene = depsgraph.scene
    settings = scene_settings(scene.original)
    wanted = settings.view
    chosen = strategy(wanted.strategy)
    eye = engine.camera_override or (scene.camera and scene.camera.evaluated_get(depsgraph))
    camera, rect, kept, pixel_filter = render_view(scene, eye, (engine.resolution_x, engine.resolution_y))
    strokes = None
    if wanted.importance is not None:  # missing input is reported before work starts
        strokes = read_strokes(wanted.importance, VISIBLE, depsgraph)  # the selection may have changed
    for text in focus_warnings(scene.original, [camera]):
        warn(engine, text)
    if scene.render.use_multiview:
        warn(engine, "PatchNet renders no stereo: all views show the picture of the middle camera")
    if scene.render.use_motion_blur:
        warn(engine, "PatchNet renders no motion blur: render with Cycles for the blur")
    making = octree_of_frame(depsgraph, camera, settings, partial(warn, engine), animation=engine.is_animation)
    octree, coded = pull(engine, making, 0.0, 0.3)
    importance = None if strokes is None else partial(strokes.weights, octree.grid, rect=rect)
    world = pull(engine, _world(engine, depsgraph, camera, octree), 0.3, 0.3)
    if wanted.render_samples is None:
        picture = AdaptivePicture(
            octree, camera, chosen, coded, importance, wanted.unrefined, pixel_filter=pixel_filter
        )
        refining = picture.refine(wanted.budget, spp=wanted.spp, refined=wanted.refined_samples)
    else:
        picture = AdaptivePicture(octree, camera, None, None, importance, pixel_filter=pixel_filter)
        refining = picture.sample_evenly(samples_side(wanted.render_samples))
    output = _Output(engine, depsgraph.view_layer.name, kept, picture, world)
    try:
        pull(engine, output.shown_meanwhile(picture.trace()), 0.3, 0.5)
        assert picture.buffers is not None
        unseen = why_unseen(octree, camera, picture.buffers.hits, float(picture.buffers.preview.max()))
        if unseen is not None:
            warn(engine, unseen)
        pull(engine, output.shown_meanwhile(refining), 0.5, 1.0)
    finally:  # a stopped render shows its unfinished picture
        output.end()


def pull(engine: bpy.types.RenderEngine, steps: Steps[Result], start: float, end: float) -> Result:
    """Run steps to their end; the frame's progress goes from `start` to `end`.

    Raises StoppedError, with the steps closed, when the user stops the render.
    """
    said = ""
    try:
        while True:
            with attended():  # a stop has an effect while kernels compile
                report = next(steps)
            text = f"{report.label} {round(100 * report.fraction)} %" + (f", {report.note}" if report.note else "")
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
    """Result of the render while it is written."""

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
        """Pass on the steps; a window shows the unfinished picture at intervals."""
        for report in steps:
            if not bpy.app.background and time.monotonic() - self._shown > _SHOWN_S:
                self._write()
                self._engine.update_result(self._result)
                self._shown = time.monotonic()
            yield report

    def end(self) -> None:
        """Write the passes into the result."""
        self._write()
        self._engine.end_result(self._result)

    def _write(self) -> None:
        pixels = pass_pixels(self._picture, self._world)
        camera, kept = self._picture.camera, self._kept
        rows, columns = slice(kept.bottom, kept.bottom + kept.height), slice(kept.left, kept.left + kept.width)
        for item in self._result.layers[0].passes:  # of each view, where there are several
            if item.name in pixels:
                picture = pixels[item.name].reshape(camera.height_px, camera.width_px, -1)
                item.rect.foreach_set(np.ascontiguousarray(picture[rows, columns]).ravel())  # without its margin


def _world(
    engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, camera: Camera, octree: Octree
) -> Steps[np.ndarray | None]:
    """World behind all surfaces, see `combined`; black, with a warning, if it cannot be evaluated."""
    baked = octree.provenance.get("light") == CYCLES
    if in_main_thread():
        with values_of_graph(depsgraph):
            seen = yield from background(depsgraph, camera, AUTO, baked=baked)
    else:
        seen = yield from awaited_background(depsgraph, camera, baked=baked)
    for warning in seen.warnings:
        warn(engine, warning)
    return seen.light


def warn(engine: bpy.types.RenderEngine, text: str) -> None:
    """Report a warning in the status bar or on the terminal, in the log, and above the picture."""
    engine.report({"WARNING"}, text)
    engine.warnings = dict.fromkeys((*engine.warnings, text))
    engine.error_set(". ".join(engine.warnings))
    event("warning", text, logging.WARNING)
