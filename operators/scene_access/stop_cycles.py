# SPDX-License-Identifier: GPL-3.0-or-later
"""Stop of a bake that runs as a job of Blender's, from Python, as Esc stops it.

A bake asks for one flag, which Esc sets, and which nothing of Python's can set. But a render that reports an error sets
it, too: so a render engine of ours fails at a picture of one pixel, in a scene of its own, which takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

import bpy

from .temporary import new_render_results_go, sync_view_layers, temporary

_NAME = "PatchNet Stop"


class _Failing(bpy.types.RenderEngine):
    """Engine that fails; it is known to Blender for a moment only, so that nobody can choose it."""

    bl_idname = "PATCHNET_STOP"
    bl_label = _NAME

    def render(self, _depsgraph: bpy.types.Depsgraph) -> None:
        """Fail."""
        self.report({"ERROR"}, "PatchNet stops the bake of Cycles")


@contextmanager
def stopped_cycles() -> Iterator[None]:
    """Let the bake that runs end at its next look at the flag; within the block its thread has to be waited for.

    The engine is forgotten after that: Blender then frees all engines, that of a bake which still runs among them.
    """
    bpy.utils.register_class(_Failing)
    try:
        _fail()
        yield
    finally:
        bpy.utils.unregister_class(_Failing)


def _fail() -> None:
    with ExitStack() as stack:
        stack.enter_context(_nobody_hears())
        stack.enter_context(new_render_results_go())
        scene = stack.enter_context(temporary(bpy.data.scenes.new(_NAME)))
        data = stack.enter_context(temporary(bpy.data.cameras.new(_NAME)))
        scene.camera = stack.enter_context(temporary(bpy.data.objects.new(_NAME, data)))
        scene.collection.objects.link(scene.camera)
        scene.render.resolution_x = scene.render.resolution_y = 4  # the least
        scene.render.engine = _Failing.bl_idname
        with suppress(RuntimeError):  # what the engine reports
            bpy.ops.render.render(scene=scene.name)
        scene.render.engine = "CYCLES"
    sync_view_layers()


@contextmanager
def _nobody_hears() -> Iterator[None]:
    """Keep the render from handlers, the user's among them."""
    kept = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers) if name.startswith("render_")}
    before = {name: list(handlers) for name, handlers in kept.items()}
    for handlers in kept.values():
        handlers.clear()
    try:
        yield
    finally:
        for name, handlers in kept.items():
            handlers[:] = before[name]
