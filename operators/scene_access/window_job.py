# SPDX-License-Identifier: GPL-3.0-or-later
"""Window jobs: work beside a window that stays alive, and waiting for Blender's own bake and render jobs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace

import bpy

from ...patchnet_addon.runtime.errors import SceneError
from ...patchnet_addon.runtime.progress import Progress, Steps
from .own import quiet

BAKE, RENDER = "OBJECT_BAKE", "RENDER"
_POLL_S = 0.1
_COMPLETE, _CANCEL = "complete", "cancel"
_HANDLERS = {
    BAKE: {_COMPLETE: bpy.app.handlers.object_bake_complete, _CANCEL: bpy.app.handlers.object_bake_cancel},
    RENDER: {_COMPLETE: bpy.app.handlers.render_complete, _CANCEL: bpy.app.handlers.render_cancel},
}
_in_window: ContextVar[bool] = ContextVar("_in_window", default=False)


@contextmanager
def in_window(alive: bool) -> Iterator[None]:
    """Steps that are pulled within the block return often, so that a window stays alive, if `alive` is true."""
    token = _in_window.set(alive)
    try:
        yield
    finally:
        _in_window.reset(token)


def window_is_alive() -> bool:
    """Return whether a window waits for these steps."""
    return _in_window.get()


def job_is_running(*kinds: str) -> bool:
    """Return whether Blender bakes or renders beside its window, or does what is in `kinds`."""
    return any(bpy.app.is_job_running(kind) for kind in kinds or (BAKE, RENDER))


def check_no_job() -> None:
    """Raise SceneError while Blender bakes or renders beside its window: a render of ours would end that."""
    if job_is_running():
        raise SceneError("Blender is rendering or baking: wait for it, or press Esc over the window, then start again")


@dataclass(frozen=True)
class JobEnd:
    """End of a job, as far as Blender says, and the seconds until then, without those of the caller that waited."""

    completed: bool
    cancelled: bool
    seconds: float


def as_job(kind: str, start: Callable[[], object], at: Callable[[], Progress]) -> Steps[JobEnd]:
    """Call `start`, which starts a job of that kind, and wait until it has ended; reports are `at`, as waiting.

    Closing these steps does not stop the job: what it works on must stay until `when_job_ended`.
    """
    ended: list[tuple[str, float]] = []
    with _told(kind, ended):
        begun = time.perf_counter()
        start()
        while job_is_running(kind):
            yield replace(at(), waiting=True)
    words = [word for word, _ in ended]
    end = ended[-1][1] if ended else time.perf_counter()
    return JobEnd(_COMPLETE in words, _CANCEL in words, end - begun)


@contextmanager
def _told(kind: str, ended: list[tuple[str, float]]) -> Iterator[None]:
    """Collect in `ended` Blender's word for the end of a job, and its time; Blender says it in the job's thread."""

    def note(word: str) -> Callable[..., None]:
        return lambda *_: ended.append((word, time.perf_counter()))

    notes = [(handlers, note(word)) for word, handlers in _HANDLERS[kind].items()]
    for handlers, each in notes:
        handlers.append(each)
    try:
        yield
    finally:
        for handlers, each in notes:
            if each in handlers:  # opening another file removes them
                handlers.remove(each)


def when_job_ended(clean_up: Callable[[], None]) -> None:
    """Call `clean_up` now, or when Blender's bake or render has ended: it must not lose what it works on."""
    if not job_is_running():
        clean_up()
        return

    def look() -> float | None:
        if job_is_running():
            return _POLL_S
        with suppress(ReferenceError), quiet():  # another file may have been opened meanwhile
            clean_up()
        return None

    bpy.app.timers.register(look, first_interval=_POLL_S)
