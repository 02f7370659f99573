# SPDX-License-Identifier: GPL-3.0-or-later
"""Final render of one frame: octree, picture and passes; the user may stop it."""

from __future__ import annotations

import logging
import time
from functools import partial

import bpy
import numpy as np

from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed, wait_for_step
from ...patchnet_addon.runtime.errors import StoppedError
from ...patchnet_addon.runtime.log import event
from ...patchnet_addon.runtime.progress import Progress, Result, Steps
from ...patchnet_addon.sampling.importance import PixelRect
from ...patchnet_addon.sampling.passes import combined
from ...patchnet_addon.sampling.registry import strategy
from ...patchnet_addon.sampling.rendered import RenderedPixels, rendered_picture
from ...patchnet_addon.tracing.camera import Camera
from ..cycles.background import background
from ..importance.pixels import read_strokes
from ..properties.job import scene_settings
from ..properties.preferences import apply_preferences
from ..scene.cameras import focus_warnings
from ..scene_access.frames import values_of_graph
from ..scene_access.main_thread import in_main_thread
from ..schema.values import AUTO, CYCLES, VISIBLE
from ..session.world_maps import awaited_background
from ..settings.groups import picture_settings
from .frame_octree import octree_of_frame
from .render_camera import render_view

_SHOWN_S = 0.7  # between two updates of the unfinished picture


def render_frame(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Render the graph's view layer into the engine's result.

    Raises StoppedError when the user stops, and PatchNetError.
    """
    apply_preferences(bpy.context)
    engine.warnings = ()
    scene = depsgraph.scene
    settings = scene_settings(scene.original)
    wanted = settings.view
    strategy(wanted.strategy)  # raises if there is none
    eye = engine.camera_override or (scene.camera and scene.camera.evaluated_get(depsgraph))
    camera, rect, kept, pixel_filter = render_view(scene, eye, (engine.resolution_x, engine.resolution_y))
    # Missing input is reported before work starts; the selection may have changed.
    strokes = read_strokes(wanted.importance, VISIBLE, depsgraph)
    for text in focus_warnings(scene.original, [camera]):
        warn(engine, text)
    if scene.render.use_multiview:
        warn(engine, "PatchNet renders no stereo: all views show the picture of the middle camera")
    if scene.render.use_motion_blur:
        warn(engine, "PatchNet renders no motion blur: render with Cycles for the blur")
    making = octree_of_frame(depsgraph, camera, settings, partial(warn, engine), animation=engine.is_animation)
    octree, coded = pull(engine, making, 0.0, 0.3)
    world = pull(engine, _world(engine, depsgraph, camera, octree), 0.3, 0.3)
    picture = picture_settings(wanted, pixel_filter)
    if picture.strategy is None:
        coded = None
    output = _Output(engine, depsgraph.view_layer.name, kept, camera, octree.exposure, world)
    tracing = Progress(0, 1, "Tracing the preview")
    try:
        importance = strokes.weights(octree.grid, rect)
        steps = computed(rendered_picture, octree, coded, camera, picture, importance, at=tracing)
        pull(engine, output.shown_meanwhile(strokes.answering(steps)), 0.3, 1.0)
    finally:  # a stopped render shows its unfinished picture
        output.end()


def pull(engine: bpy.types.RenderEngine, steps: Steps[Result], start: float, end: float) -> Result:
    """Run steps to their end; the frame's progress goes from `start` to `end`.

    Raises StoppedError, with the steps closed, when the user stops the render.
    """
    said = ""
    try:
        while True:
            report = next(steps)
            text = f"{report.label} {round(100 * report.fraction)} %" + (f", {report.note}" if report.note else "")
            if text != said:  # in background Blender prints it
                said = text
                engine.update_stats("PatchNet", text)
                share = report.fraction if report.whole is None else report.whole
                engine.update_progress(start + (end - start) * share)
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
        camera: Camera,
        exposure: float,
        world: np.ndarray | None,
    ) -> None:
        self._engine, self._kept, self._size = engine, kept, (camera.height_px, camera.width_px)
        self._exposure, self._world = exposure, world
        self._pixels: RenderedPixels | None = None
        self._result = engine.begin_result(0, 0, kept.width, kept.height, layer=layer)
        self._shown = time.monotonic()

    def shown_meanwhile(self, steps: Steps[None]) -> Steps[None]:
        """Pass on the steps of a `rendered_picture`; a window shows the unfinished picture at intervals."""
        try:
            for report in steps:
                if report.partial is not None:
                    self._take(report.partial)
                if not bpy.app.background and time.monotonic() - self._shown > _SHOWN_S:
                    self._write()
                    self._engine.update_result(self._result)
                    self._shown = time.monotonic()
                yield report
        finally:
            steps.close()
            wait_for_step()  # else a stopped render would show half a batch

    def end(self) -> None:
        """Write the passes into the result."""
        self._write()
        self._engine.end_result(self._result)

    def _take(self, pixels: RenderedPixels) -> None:
        self._pixels = pixels
        if pixels.unseen is not None:
            warn(self._engine, pixels.unseen)

    def _write(self) -> None:
        """Write what is there: only Combined while pixels are being traced."""
        if self._pixels is None:
            return
        values, samples, passes, _ = self._pixels
        pixels = {"Combined": combined(values, self._exposure, self._world), **passes}
        if passes:
            pixels["Sample Count"] = samples.astype(np.float32)
        kept = self._kept
        rows, columns = slice(kept.bottom, kept.bottom + kept.height), slice(kept.left, kept.left + kept.width)
        for item in self._result.layers[0].passes:  # of each view, where there are several
            if item.name in pixels:
                picture = pixels[item.name].reshape(*self._size, -1)
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
