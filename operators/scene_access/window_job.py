# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs in a responsive window, among them Blender's bake and render jobs on copies of scenes.

Blender's bake operator ends at the next event unless the window shows the baked scene, and frees the reports that the
job's thread writes to. As the first step of a macro it lives until the second step ends, which waits for the job. The
macro also hides the report at the end of each page, which asks users to save an image that is not theirs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from dataclasses import replace
from typing import ClassVar

import bpy

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Progress, Steps
from .stop_cycles import stopped_cycles
from .window_state import Part

BAKE, RENDER = "OBJECT_BAKE", "RENDER"
COMPLETE, CANCEL, INTERRUPTED = "complete", "cancel", "interrupted"
_HANDLERS = {
    BAKE: {
        COMPLETE: bpy.app.handlers.object_bake_complete,
        CANCEL: bpy.app.handlers.object_bake_cancel,
        INTERRUPTED: bpy.app.handlers.render_init,
    },
    RENDER: {COMPLETE: bpy.app.handlers.render_complete, CANCEL: bpy.app.handlers.render_cancel},
}
_in_window: ContextVar[bool] = ContextVar("_in_window", default=False)
_own_kinds = Part("own_jobs", list[str])  # kinds of our running jobs
_swallowed = Part("swallowed", list[str])  # Esc that the macro got in place of the job
_STOPS_WITHIN_S = 10.0  # of a click on Blender's stop button
_clicks = Part("clicks", list[float])  # times of clicks on the status bar


@contextmanager
def in_window(alive: bool) -> Iterator[None]:
    """Mark whether a window waits for the steps of the block, so that they return often."""
    token = _in_window.set(alive)
    try:
        yield
    finally:
        _in_window.reset(token)


def escaped(event: bpy.types.Event) -> bool:
    """Return whether an event is Esc, or the macro below got one in place of whoever asks, once."""
    if _swallowed():
        _swallowed().clear()
        return True
    return event.type == "ESC" and event.value == "PRESS"


def note_click(context: bpy.types.Context, event: bpy.types.Event) -> None:
    """Note a click on the status bar, where Blender's stop button is: a bake that it ends is told to be complete."""
    if event.type == "LEFTMOUSE" and event.mouse_y < min(area.y for area in context.window.screen.areas):
        _clicks().append(time.perf_counter())


def window_is_alive() -> bool:
    """Return whether a window waits for these steps."""
    return _in_window.get()


def job_is_running(*kinds: str) -> bool:
    """Return whether a bake or render job runs, or one of `kinds`."""
    return any(bpy.app.is_job_running(kind) for kind in kinds or (BAKE, RENDER))


def others_job_is_running() -> bool:
    """Return whether a bake or render job of others runs, which a job of ours would stop."""
    return any(job_is_running(kind) for kind in (BAKE, RENDER) if kind not in _own_kinds())


def check_no_job() -> None:
    """Raise SceneError while a bake or render job runs, which a render of ours would end."""
    if job_is_running():
        raise SceneError("Blender is rendering or baking: wait for it, or press Esc over the window, then start again")


def as_job(
    kind: str, scene: bpy.types.Scene, start: Callable[[], object], at: Callable[[], Progress]
) -> Steps[dict[str, float]]:
    """Call `start`, which starts a job of a kind on a copy of a scene, and wait until it ends.

    Reports are `at`, as waiting. The result is the times of what Blender reported: COMPLETE, CANCEL, or INTERRUPTED by
    a render of the user, for which Blender ends all other jobs. Closing these steps stops the job, waits for its thread
    and deletes the copy.
    """
    ended, kinds = dict[str, float](), _own_kinds()
    with _told(kind, ended):
        start()
        _clicks().clear()
        kinds.append(kind)
        try:
            while job_is_running(kind):
                yield replace(at(), waiting=True)
        except GeneratorExit:
            _end(kind, scene)
            raise
        finally:
            kinds.remove(kind)
            _swallowed().clear()
        if kind == BAKE and COMPLETE in ended and any(ended[COMPLETE] - at < _STOPS_WITHIN_S for at in _clicks()):
            ended[CANCEL] = ended.pop(COMPLETE)
    return ended


@contextmanager
def _told(kind: str, ended: dict[str, float]) -> Iterator[None]:
    """Collect in `ended` how a job ended, and when; Blender calls handlers in the job's thread."""

    def note(word: str) -> Callable[..., None]:
        return lambda *_: ended.update({word: time.perf_counter()})

    notes = [(handlers, note(word)) for word, handlers in _HANDLERS[kind].items()]
    for handlers, each in notes:
        handlers.append(each)
    try:
        yield
    finally:
        for handlers, each in notes:
            if each in handlers:  # opening another file removes them
                handlers.remove(each)


def _end(kind: str, scene: bpy.types.Scene) -> None:
    """End a job by deleting its scene, for which Blender waits for the job's thread."""
    if job_is_running(kind):
        with bpy.context.temp_override(scene=scene), stopped_cycles() if kind == BAKE else nullcontext():
            bpy.ops.scene.delete()


@contextmanager
def editors_keep_images(manager: bpy.types.WindowManager) -> Iterator[Callable[[], None]]:
    """Restore the images of Image Editors: Blender shows a baked image in the largest one, and a job's in all of them.

    The value restores them at once; Blender replaces the images shortly after a job begins.
    """
    areas = [area for window in manager.windows for area in window.screen.areas if area.type == "IMAGE_EDITOR"]
    shown = [(area.spaces.active, area.spaces.active.image) for area in areas]

    def give_back() -> None:
        for space, image in shown:
            with suppress(ReferenceError):  # the editor or the image is gone
                if space.image != image:
                    space.image = image

    try:
        yield give_back
    finally:
        give_back()


@contextmanager
def render_result_hidden(manager: bpy.types.WindowManager) -> Iterator[None]:
    """Let no Image Editor show the Render Result within the block, which a handler of render statistics needs.

    Cycles calls such a handler, which waits for Python, while it holds what the editor waits for to draw the render in
    progress; the editor draws within Python, and Blender hangs.
    """
    areas = [area for window in manager.windows for area in window.screen.areas if area.type == "IMAGE_EDITOR"]
    spaces = [area.spaces.active for area in areas]
    shown = [
        (space, space.image) for space in spaces if space.image is not None and space.image.type == "RENDER_RESULT"
    ]
    for space, _ in shown:
        space.image = None
    try:
        yield
    finally:
        for space, image in shown:
            with suppress(ReferenceError):
                space.image = image if space.image is None else space.image


class PATCHNET_OT_await_bake(bpy.types.Operator):
    """Wait until the bake has ended"""

    bl_idname = "patchnet.await_bake"
    bl_label = "Await Bake"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin to wait; no other operator gets the event that ended the step before, so an Esc is noted."""
        if escaped(event):
            _swallowed().append(event.type)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, _context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Pass all events through."""
        return {"PASS_THROUGH"} if job_is_running(BAKE) else {"FINISHED", "PASS_THROUGH"}


class PATCHNET_OT_bake_beside_window(bpy.types.Macro):
    """Bake a copy of the scene beside the window"""

    bl_idname = "patchnet.bake_beside_window"
    bl_label = "Bake Beside Window"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}


def register() -> None:
    """Register the steps of the macro."""
    for name in ("OBJECT_OT_bake", "PATCHNET_OT_await_bake"):
        PATCHNET_OT_bake_beside_window.define(name)
