# SPDX-License-Identifier: GPL-3.0-or-later
"""Stop a bake or render job of Blender from Python, as Esc does.

A bake polls a flag that Esc sets and that Python cannot set. A render that reports an error also sets it, so a render
engine of ours fails in a scene of its own, which takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

import bpy

from .overrides import changed
from .temporary import new_render_results_go, sync_view_layers, temporary

_NAME = "PatchNet Stop"
_OF_ENGINES = ("RENDER", "RENDER_PREVIEW")  # Blender's jobs that work with an engine


class _Failing(bpy.types.RenderEngine):
    """Engine that fails; it is registered only for a moment, so that users cannot choose it."""

    bl_idname = "PATCHNET_STOP"
    bl_label = _NAME

    def render(self, _depsgraph: bpy.types.Depsgraph) -> None:
        """Fail."""
        self.report({"ERROR"}, "PatchNet stops the render or bake")


@contextmanager
def stopped_cycles() -> Iterator[None]:
    """Stop the current bake at its next poll; the block has to wait for its thread."""
    bpy.utils.register_class(_Failing)
    try:
        with _failing_scene() as scene, suppress(RuntimeError):  # what the engine reports
            bpy.ops.render.render(scene=scene.name)
        yield
    finally:
        _end_renders()
        bpy.utils.unregister_class(_Failing)


def forget_engine(engine: type[bpy.types.RenderEngine]) -> None:
    """Unregister an engine after all renders and previews, of any engine, have ended.

    Blender then frees all engines, and crashes if one of them is at work.
    """
    bpy.utils.register_class(_Failing)
    try:
        _end_renders()
        bpy.utils.unregister_class(engine)
    finally:
        bpy.utils.unregister_class(_Failing)


def _end_renders() -> None:
    """End all renders in a window: a new render ends them, and ends itself with its scene."""
    windows = bpy.context.window_manager.windows
    if not windows or not any(bpy.app.is_job_running(kind) for kind in _OF_ENGINES):
        return
    with ExitStack() as stack:
        stack.enter_context(changed(bpy.context.preferences.view, render_display_type="NONE"))
        scene = stack.enter_context(_failing_scene())
        stack.enter_context(bpy.context.temp_override(window=windows[0]))
        with suppress(RuntimeError):  # what the engine reports, if it is that quick
            bpy.ops.render.render("INVOKE_DEFAULT", scene=scene.name)
        with bpy.context.temp_override(scene=scene):  # given with the window, it would be the window's own
            bpy.ops.scene.delete()


@contextmanager
def _failing_scene() -> Iterator[bpy.types.Scene]:
    """Make a temporary scene whose render fails."""
    with ExitStack() as stack:
        stack.callback(sync_view_layers)
        stack.enter_context(_without_handlers())
        stack.enter_context(new_render_results_go())
        scene = stack.enter_context(temporary(bpy.data.scenes.new(_NAME)))
        data = stack.enter_context(temporary(bpy.data.cameras.new(_NAME)))
        scene.camera = stack.enter_context(temporary(bpy.data.objects.new(_NAME, data)))
        scene.collection.objects.link(scene.camera)
        scene.render.resolution_x = scene.render.resolution_y = 4  # the least
        scene.render.engine = _Failing.bl_idname
        yield scene
        with suppress(ReferenceError):  # of a deleted scene
            scene.render.engine = "CYCLES"


@contextmanager
def _without_handlers() -> Iterator[None]:
    """Hide the render from all handlers, the user's included."""
    kept = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers) if name.startswith("render_")}
    before = {name: list(handlers) for name, handlers in kept.items()}
    for handlers in kept.values():
        handlers.clear()
    try:
        yield
    finally:
        for name, handlers in kept.items():
            handlers[:] = before[name]
