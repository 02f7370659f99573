# SPDX-License-Identifier: GPL-3.0-or-later
"""What all operators share: one way to run steps, to show progress, to stop, and to report what went wrong."""

from __future__ import annotations

import time
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import bpy

from ..patchnet_addon.beside import attended
from ..patchnet_addon.errors import PatchNetError, StoppedError
from ..patchnet_addon.interrupt import prompt_interrupt
from ..patchnet_addon.log import unexpected
from ..patchnet_addon.progress import Progress, Steps
from ..patchnet_addon.progress_log import ProgressLog
from ..patchnet_addon.remaining import Remaining
from . import results
from .job.settings import JobSettings
from .memory import give_back
from .preferences import apply_preferences
from .properties import job_settings
from .tell import tell, tell_start
from .window_job import in_window

if TYPE_CHECKING:
    from bpy.types import Operator as _Operator
else:
    _Operator = object  # Blender wants its own class among the direct bases of each operator

_SLICE_S = 0.05  # of work between two redraws of the window
_TICK_S = 0.02
_LOOKING = frozenset(
    {
        "MOUSEMOVE",
        "INBETWEEN_MOUSEMOVE",
        "MIDDLEMOUSE",
        "WHEELUPMOUSE",
        "WHEELDOWNMOUSE",
        "TRACKPADPAN",
        "TRACKPADZOOM",
        "WINDOW_DEACTIVATE",
    }
)


class JobOperator(_Operator):
    """Mixin of operators that run steps.

    `execute` runs them to the end, so that the operator works in background and from scripts; in a window `invoke` runs
    them a slice of time per timer tick, with progress in the status bar, until Esc. Both end the same way.
    """

    bl_options: ClassVar[set[str]] = {"REGISTER"}
    running: ClassVar[str] = ""  # title of the operator that works in a window now
    fraction: ClassVar[float] = 0.0  # of its present step, or of all, for the panel
    _outcome: set[str]
    _file: Path | None = None  # what the steps write, for the log

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
        """Run all steps now, until Ctrl-C where there is no window."""
        steps = self._begin(context)
        if steps is None:
            return {"CANCELLED"}
        try:
            with prompt_interrupt() if bpy.app.background else nullcontext():
                while not self._outcome:
                    self._pull(steps, alive=False)
        except KeyboardInterrupt:
            tell(self, "ERROR", self._stopped())
            self._outcome = {"CANCELLED"}
        except Exception as error:
            unexpected(error)
            raise
        finally:
            steps.close()
            give_back()
        return self._outcome

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Run the steps while the window stays alive."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        steps = self._begin(context)
        if steps is None:
            return {"CANCELLED"}
        self._steps = steps
        JobOperator.running, JobOperator.fraction = self.bl_label, 0.0
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(_TICK_S, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Work for a slice of time per tick; Esc stops and cleans up."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            tell(self, "INFO", self._stopped(), logged_as="ERROR")
            return {"CANCELLED"}
        if event.type != "TIMER":
            # Looking around is harmless; anything else could change what is being read.
            return {"PASS_THROUGH"} if event.type in _LOOKING else {"RUNNING_MODAL"}
        deadline = time.perf_counter() + _SLICE_S
        try:
            self._pull(self._steps, alive=True)
            while not self._outcome and not self._progress.waiting and time.perf_counter() < deadline:
                self._pull(self._steps, alive=True)
        except BaseException:
            self._end_modal(context)
            raise
        if self._outcome:
            self._end_modal(context)
            return self._outcome
        self._show(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender calls this when the window closes."""
        with results.quiet():  # what stopping puts back is as it was
            self._steps.close()
        self._quiet.close()
        self._end_modal(context)

    def _begin(self, context: bpy.types.Context) -> Steps[str] | None:
        """The steps, or None after the settings' errors were reported."""
        self._outcome = set()
        self._quiet = ExitStack()
        self._progress = Progress(0, 1, self.bl_label)
        self._text = ""  # what the status bar shows
        self._log = ProgressLog(self.bl_label)
        self._remaining, self._whole_remaining = Remaining(), Remaining()
        try:
            apply_preferences(context)
            tell_start(self)
            return self.steps(context, job_settings(context, self))
        except PatchNetError as error:
            tell(self, "ERROR", str(error))
            return None

    def _pull(self, steps: Steps[str], *, alive: bool) -> None:
        """One step, which sets the outcome if it was the last. Domain errors become reports here and nowhere else.

        alive: the step returns soon, with work left to others, because a window waits.
        """
        if not self._progress.waiting:
            self._quiet.enter_context(results.quiet())
        try:
            with in_window(alive), attended() if alive or bpy.app.background else nullcontext():
                progress = next(steps)
        except StopIteration as stop:
            tell(self, "INFO", stop.value, file=self._file)
            self._outcome = {"FINISHED"}
        except StoppedError as error:
            text = self._stopped() if alive else str(error)
            tell(self, "INFO" if alive else "ERROR", text, logged_as="ERROR")
            self._outcome = {"CANCELLED"}
        except PatchNetError as error:
            tell(self, "ERROR", str(error))
            self._outcome = {"CANCELLED"}
        except MemoryError:
            tell(self, "ERROR", f"{self.bl_label} ran out of memory: choose a smaller depth or fewer objects")
            self._outcome = {"CANCELLED"}
        else:
            self._log.see(progress)
            self._remaining.see(progress)
            if progress.whole is not None:
                self._whole_remaining.see(Progress(progress.whole, 1.0, self.bl_label))
            self._progress = progress
        finally:
            if self._outcome or not self._progress.waiting:
                self._quiet.close()

    def _stopped(self) -> str:
        return f"{self.bl_label} was stopped: nothing was changed"

    def _show(self, context: bpy.types.Context) -> None:
        progress = self._progress
        percent = round(100 * progress.fraction)
        fraction = progress.fraction if progress.whole is None else round(progress.whole, 3)
        if fraction != JobOperator.fraction:
            JobOperator.fraction = fraction
            _redraw(context, "UI")
        left = (self._remaining if progress.whole is None else self._whole_remaining).text()
        remaining = "".join(f", {text}" for text in (left, progress.note) if text)
        text = f"PatchNet: {progress.label} {percent} %{remaining}   (Esc stops)"
        if text != self._text:  # each new one draws the window again, which must not slow down what computes
            self._text = text
            context.window_manager.progress_update(round(100 * fraction))
            context.workspace.status_text_set(text)

    def _end_modal(self, context: bpy.types.Context) -> None:
        JobOperator.running = ""
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        give_back()
        _redraw(context)


def _redraw(context: bpy.types.Context, *kinds: str) -> None:
    """Draw the regions of some kinds again, such as the sidebars ("UI"); without kinds, all."""
    for area in context.screen.areas if context.screen else ():
        for region in area.regions:
            if not kinds or region.type in kinds:
                region.tag_redraw()
