# SPDX-License-Identifier: GPL-3.0-or-later
"""What all operators share: one way to run steps, to show progress, to stop, and to report what went wrong."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar

import bpy

from ..patchnet_addon.errors import PatchNetError
from ..patchnet_addon.progress import Progress, Steps
from . import results
from .job.settings import JobSettings
from .preferences import LOG, apply_preferences
from .properties import job_settings

if TYPE_CHECKING:
    from bpy.types import Operator as _Operator
else:
    _Operator = object  # Blender wants its own class among the direct bases of each operator

_SLICE_S = 0.05  # of work between two redraws of the window
_TICK_S = 0.02


class JobOperator(_Operator):
    """Mixin of operators that run steps.

    `execute` runs them to the end, so that the operator works in background and from scripts; in a window `invoke` runs
    them a slice of time per timer tick, with progress in the status bar, until Esc. Both end the same way.
    """

    bl_options: ClassVar[set[str]] = {"REGISTER"}
    running: ClassVar[str] = ""  # title of the operator that works in a window now

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """The work; its result is a sentence about what was done. It leaves the scene as it was, also when closed."""
        raise RuntimeError(f"{type(self).__name__} has no steps")

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """One job at a time; operators that need more call this first."""
        if JobOperator.running:
            cls.poll_message_set(f"{JobOperator.running} is running: wait for it, or press Esc over the window")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run all steps now."""
        steps = self._begin(context)
        if steps is None:
            return {"CANCELLED"}
        while self._pull(steps) is None:
            pass
        return self._outcome

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Run the steps while the window stays alive."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        steps = self._begin(context)
        if steps is None:
            return {"CANCELLED"}
        self._steps = steps
        JobOperator.running = self.bl_label
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(_TICK_S, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Work for a slice of time per tick; Esc stops and cleans up."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"INFO"}, f"{self.bl_label} was stopped: nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            # Input would reach the scene while it is prepared for baking; looking around is harmless.
            looking = event.type in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "WINDOW_DEACTIVATE"}
            return {"PASS_THROUGH"} if looking or event.type.startswith("TIMER") else {"RUNNING_MODAL"}
        deadline = time.perf_counter() + _SLICE_S
        while time.perf_counter() < deadline:
            progress = self._pull(self._steps)
            if progress is not None:
                self._end_modal(context)
                return self._outcome
        self._show(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender calls this when the window closes."""
        self._steps.close()
        self._end_modal(context)

    def _begin(self, context: bpy.types.Context) -> Steps[str] | None:
        """The steps, or None after the settings' errors were reported."""
        self._outcome: set[str] = set()
        self._progress = Progress(0, 1, self.bl_label)
        try:
            apply_preferences(context)
            return self.steps(context, job_settings(context, self))
        except PatchNetError as error:
            self.report({"ERROR"}, str(error))
            return None

    def _pull(self, steps: Steps[str]) -> set[str] | None:
        """One step; the outcome if it was the last one. Domain errors become reports here and nowhere else."""
        try:
            with results.quiet():
                progress = next(steps)
        except StopIteration as stop:
            self.report({"INFO"}, stop.value)
            self._outcome = {"FINISHED"}
        except PatchNetError as error:
            self.report({"ERROR"}, str(error))
            self._outcome = {"CANCELLED"}
        except MemoryError:
            self.report({"ERROR"}, f"{self.bl_label} ran out of memory: choose a smaller depth or fewer objects")
            self._outcome = {"CANCELLED"}
        else:
            if progress.label != self._progress.label:
                LOG.info("%s: %s", self.bl_label, progress.label)
            self._progress = progress
        return self._outcome or None

    def _show(self, context: bpy.types.Context) -> None:
        progress = self._progress
        percent = round(100 * progress.fraction)
        context.window_manager.progress_update(percent)
        text = f"PatchNet: {progress.label} {percent} %   (Esc stops)"
        context.workspace.status_text_set(text)

    def _end_modal(self, context: bpy.types.Context) -> None:
        JobOperator.running = ""
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        for area in context.screen.areas if context.screen else ():
            area.tag_redraw()
