# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a copy of a scene into a file, by one call or as a job beside a responsive window.

Python cannot stop a call. In a window, the render is a job of Blender, as with F12: steps wait for it, and Esc stops
it.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ...patchnet_addon.runtime.errors import PatchNetError, SceneError, StoppedError
from ...patchnet_addon.runtime.interrupt import interrupts_wait
from ...patchnet_addon.runtime.progress import Progress, Steps
from ..scene_access.overrides import changed
from ..scene_access.window_job import RENDER, as_job, window_is_alive

# Status text of Cycles, equal in all languages.
_SAMPLED = re.compile(r"(?:Rendered (\d+)/(\d+) Tiles, )?Sample (\d+)/(\d+)")


def render(scene: bpy.types.Scene, path: Path) -> float:
    """Render the copy's view layer into `path`, a new file; return the seconds.

    Raises SceneError if Cycles does not render, PatchNetError if it wrote no file.
    """
    path.unlink(missing_ok=True)
    begun = time.perf_counter()
    _called(scene, "EXEC_DEFAULT")
    _check_written(path)
    return time.perf_counter() - begun


def rendered(scene: bpy.types.Scene, path: Path, at: Callable[[float], Progress]) -> Steps[float]:
    """Render as `render`, but as a job if a window waits; reports are `at` of the share of finished samples.

    Raises StoppedError if the user stops it.
    """
    if not window_is_alive():
        return render(scene, path)
    path.unlink(missing_ok=True)
    status = _Status()
    bpy.app.handlers.render_stats.append(status.hear)
    try:
        end = yield from as_job(RENDER, scene, lambda: _invoked(scene), lambda: at(status.done))
    finally:
        if status.hear in bpy.app.handlers.render_stats:  # opening another file removes it
            bpy.app.handlers.render_stats.remove(status.hear)
    if end.cancelled:
        raise StoppedError("The render was stopped")
    status.check_finished()
    _check_written(path)
    return end.seconds


class _Status:
    """Status of a Cycles render, heard in its thread: share of finished samples, 0 to 1, and its end."""

    def __init__(self) -> None:
        self.done = 0.0
        self._finished = False
        self._last = ""

    def check_finished(self) -> None:
        """Raise SceneError for a failed render, which also writes a picture, such as without enough GPU memory."""
        if self._last and not self._finished:
            raise SceneError(f"Cycles did not finish the picture ({self._last}): Blender's terminal may say more")

    def hear(self, text: object, *_: object) -> None:
        """Parse a line of Blender's status, which ends with the status of Cycles; Blender calls this."""
        if not isinstance(text, str) or "|" not in text:
            return
        self._last = text.rsplit("|", 1)[1].strip()
        self._finished |= self._last == "Finished"
        found = _SAMPLED.search(self._last)
        if found is None:
            return
        tile, tiles, sample, samples = (int(number) if number else 0 for number in found.groups())
        # A tile counts as finished before the next one reports its first sample.
        part = (sample % samples) / samples if samples else 0.0
        self.done = max(self.done, min(1.0, (tile + part) / max(tiles, 1)))


def _invoked(scene: bpy.types.Scene) -> None:
    with _no_view():
        _called(scene, "INVOKE_DEFAULT")


@contextmanager
def _no_view() -> Iterator[None]:
    """Prevent the render from opening an editor or window, which Blender does only while the job starts."""
    preferences = bpy.context.preferences
    was_dirty = preferences.is_dirty
    try:
        with changed(preferences.view, render_display_type="NONE"):
            yield
    finally:
        preferences.is_dirty = was_dirty


def _called(scene: bpy.types.Scene, how: str) -> None:
    try:
        with interrupts_wait():
            bpy.ops.render.render(how, write_still=True, scene=scene.name)
    except RuntimeError as cause:
        raise SceneError(f"Cycles cannot render the scene ({str(cause).strip().removeprefix('Error: ')})") from cause


def _check_written(path: Path) -> None:
    if not path.is_file():
        raise PatchNetError("Cycles wrote no picture: check that the folder for temporary files has room")
