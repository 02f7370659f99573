# SPDX-License-Identifier: GPL-3.0-or-later
"""Work beside a window that stays alive, and Blender's bake job, which is the part of it that is not ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar

import bpy

_JOB = "OBJECT_BAKE"
_POLL_S = 0.1
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
    """Whether a window waits for these steps."""
    return _in_window.get()


def job_is_running() -> bool:
    """Whether Blender bakes beside its window."""
    return bool(bpy.app.is_job_running(_JOB))


def when_job_ended(clean_up: Callable[[], None]) -> None:
    """Call `clean_up` now, or when Blender's bake job has ended: it must not lose what it works on."""
    if not job_is_running():
        clean_up()
        return

    def look() -> float | None:
        if job_is_running():
            return _POLL_S
        with suppress(ReferenceError):  # another file may have been opened meanwhile
            clean_up()
        return None

    bpy.app.timers.register(look, first_interval=_POLL_S)
