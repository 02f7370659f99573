# SPDX-License-Identifier: GPL-3.0-or-later
"""Base of all job operators: requirements, messages, steps with progress, stop, and reports of errors."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import bpy
from bpy.app.handlers import persistent

from ...patchnet_addon.process.computed import refused, settle
from ...patchnet_addon.runtime import log
from ...patchnet_addon.runtime.errors import FileAccessError, FilesGoneError, PatchNetError, StoppedError
from ...patchnet_addon.runtime.log import unexpected
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.runtime.quantities import counted
from ..properties.job import job_settings
from ..properties.preferences import apply_preferences
from ..scene_access.own import quiet
from ..scene_access.unread_file import check_opened
from ..scene_access.window_job import escaped, in_window, note_click, others_job_is_running
from ..scene_access.window_state import Part
from ..session import results
from ..session.octree_cache import result_or_kept
from ..session.scene_session import give_back
from ..settings.job_settings import JobSettings
from ..state.watch import change_monitor
from .job_window import JobDisplay, passes

if TYPE_CHECKING:

    class OperatorBase(bpy.types.Operator):
        """Base of mixins for operators."""
else:
    OperatorBase = object  # Blender requires its own class among the direct bases of each operator

SLICE_S = 0.02  # of work between two redraws of the window
_TICK_S = 0.01
_GONE = "The scene of this job was deleted or closed: open it and start again"


def tell(operator: bpy.types.Operator, kind: str, text: str, *, logged_as: str = "", **fields: Any) -> None:
    """Report INFO, WARNING or ERROR, and log it.

    logged_as: another kind for the log. fields: of the event.
    """
    operator.report({kind}, text)
    logged = logged_as or kind
    log.event("result" if logged == "INFO" else logged.lower(), text, getattr(logging, logged), **fields)


def tell_notes(operator: bpy.types.Operator, notes: Iterable[str], below: str = "Preview Selection") -> str:
    """Report notes as warnings; return the end of a report with their number and place."""
    said = list(dict.fromkeys(notes))
    for text in said:
        tell(operator, "WARNING", text)
    where = "" if bpy.app.background else f" below {below}"
    return f"; {counted(len(said), 'note')}{where}" if said else ""


def tell_start(operator: bpy.types.Operator) -> None:
    """Log that an operator begins, with its file."""
    log.start(operator.bl_label, file=bpy.data.filepath or None)


class JobOperator(OperatorBase):
    """Mixin of operators that run steps.

    `execute` runs them to the end, in background and from scripts; in a window, `invoke` runs them in slices of time,
    with progress in the status bar, until Esc. Both end the same way.

    In a window, Blender stays usable except for editing, and the steps stay in the scene where they began.
    """

    bl_options: ClassVar[set[str]] = {"REGISTER"}
    _outcome: set[str]
    _steps: Steps[str]
    _file: Path | None = None  # output, for the log
    _goes_on: bool = False  # a stopped job resumes when it is started again

    def steps(self, context: bpy.types.Context, settings: JobSettings) -> Steps[str]:
        """Do the work, and return a sentence about the result; a job that is closed leaves the scene unchanged."""
        raise RuntimeError(f"{type(self).__name__} has no steps")

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        """Require that no job runs; operators that need more call this first."""
        return no_job_runs(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run all steps now."""
        if not self._begin(context):
            return {"CANCELLED"}
        try:
            while not self._outcome:
                self._pull(alive=False)
        except Exception as error:
            unexpected(error)
            raise
        finally:
            self._steps.close()
            give_back()
        return self._outcome

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Run the steps in a responsive window."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if not self._begin(context):
            return {"CANCELLED"}
        self._scene, self._layer = context.scene, context.view_layer
        change_monitor().begin(context.scene)
        job = job_in_window()
        job.operator, job.display = self, self._display
        self._display.begin(context)
        self._timer = context.window_manager.event_timer_add(_TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Work for a slice of time per tick; Esc stops and cleans up."""
        if self._outcome:  # the job ended meanwhile, and this handler must, too
            self._end_modal(context)
            return self._outcome
        note_click(context, event)
        if escaped(event):
            self.cancel(context)
            tell(self, "INFO", self._stopped(), logged_as="ERROR")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"} if passes(context, event) else {"RUNNING_MODAL"}
        try:
            self._work(context)
        except BaseException:
            self._outcome = {"CANCELLED"}
            self._end_modal(context)
            raise
        if self._outcome:
            self._end_modal(context)
            return self._outcome
        self._display.show(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop the job when the window closes; Blender calls this. The next event ends the operator.

        Blender also calls it when a file browser is cancelled, before the job begins.
        """
        if job_in_window().operator is not self:
            return
        self._outcome = self._outcome or {"CANCELLED"}
        try:
            with quiet():  # stopping restores the scene
                self._steps.close()
            settle()
        finally:
            self._end_modal(context)

    def _begin(self, context: bpy.types.Context) -> bool:
        """Make the steps; return False after reporting errors of settings."""
        self._outcome = set()
        self._display = JobDisplay(self.bl_label)
        try:
            apply_preferences(context)
            tell_start(self)
            check_opened()
            self._steps = self.steps(context, job_settings(context, self))
        except PatchNetError as error:
            tell(self, "ERROR", str(error))
            return False
        return True

    def _work(self, context: bpy.types.Context) -> None:
        """Run steps for a slice of time, in the scene where they began."""
        if others_job_is_running():
            self._display.see(replace(self._display.progress, note="waits for Blender's render"))
            return
        deadline = time.perf_counter() + SLICE_S
        while not self._outcome:
            try:
                place = self._in_scene(context)
            except ReferenceError:
                self.cancel(context)
                tell(self, "ERROR", _GONE)
                return
            with place:
                self._pull(alive=True)
            if self._display.progress.waiting or time.perf_counter() >= deadline:
                return

    def _in_scene(self, context: bpy.types.Context) -> Any:
        """Context in which the steps began; the window may show another scene or view layer now."""
        if context.scene == self._scene and context.view_layer == self._layer:
            return nullcontext()
        self._scene.name, self._layer.name  # noqa: B018  raises ReferenceError if they were deleted
        return context.temp_override(scene=self._scene, view_layer=self._layer)

    def _pull(self, *, alive: bool) -> None:
        """Pull a step, and set the outcome after the last one; only here, domain errors become reports.

        alive: a window waits, so that bakes and renders of Cycles are jobs of Blender.
        """
        try:
            with quiet(), in_window(alive):
                progress = next(self._steps)
        except StopIteration as stop:
            tell(self, "INFO", stop.value, file=self._file)
            if refused():
                tell(self, "WARNING", refused())
            self._outcome = {"FINISHED"}
        except StoppedError as error:
            text = self._stopped() if alive else str(error)
            tell(self, "INFO" if alive else "ERROR", text, logged_as="ERROR")
            self._outcome = {"CANCELLED"}
        except (PatchNetError, ImportError, OSError, MemoryError) as error:
            sentence = self._explained(error)
            if sentence is None:
                raise
            tell(self, "ERROR", sentence)
            self._outcome = {"CANCELLED"}
        else:
            self._display.see(progress)

    def _explained(self, error: PatchNetError | ImportError | OSError | MemoryError) -> str | None:
        if isinstance(error, MemoryError):
            return f"{self.bl_label} ran out of memory: choose a smaller depth or fewer objects"
        if isinstance(error, PatchNetError):
            return str(error)
        found = FilesGoneError.of(error) or (FileAccessError.of(error) if isinstance(error, OSError) else None)
        return None if found is None else str(found)

    def _stopped(self) -> str:
        return (
            "Stopped. Press again to go on." if self._goes_on else f"{self.bl_label} was stopped: nothing was changed"
        )

    def _end_modal(self, context: bpy.types.Context) -> None:
        job = job_in_window()
        if job.operator is not self:
            return
        job.operator = job.display = None
        change_monitor().end()
        context.window_manager.event_timer_remove(self._timer)
        self._display.end(context)
        give_back()


@dataclass(eq=False)
class JobInWindow:
    """Job that works in a window now, and its display; None while there is none."""

    operator: JobOperator | None = None
    display: JobDisplay | None = None

    @property
    def title(self) -> str:
        """Title of the job, or ""."""
        return "" if self.display is None else self.display.title


job_in_window = Part("job", JobInWindow)


@persistent
def stop_running_job(*_: object) -> None:
    """End the job in a window before an undo, another file or Blender's exit frees its data-blocks."""
    operator = job_in_window().operator
    if operator is not None and not operator._outcome:
        operator.cancel(bpy.context)


# Blender 4.5 has no exit_pre.
HANDLERS = tuple((name, stop_running_job) for name in ("undo_pre", "redo_pre", "load_pre", "exit_pre"))


class VoxelJob(JobOperator):
    """Job on the voxels of the scene."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require voxels."""
        return has_voxels(cls, context) and super().poll(context)


class CodesJob(JobOperator):
    """Job on the codes of the scene."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Require codes."""
        result = result_or_kept(context.scene)
        return _unless(cls, result is None or result.coded is None, results.NO_CODES) and super().poll(context)


def has_voxels(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether there are voxels; else set the poll message."""
    return _unless(operator, result_or_kept(context.scene) is None, results.NO_VOXELS)


def in_object_mode(operator: Any, context: bpy.types.Context, what: str) -> bool:
    """Return whether Object Mode is active, which `what` needs; else set the poll message."""
    return _unless(operator, context.mode != "OBJECT", f"{what} in Object Mode only: leave the present mode")


def no_job_runs(operator: Any) -> bool:
    """Return whether no job runs in a window; else set the poll message."""
    running = job_in_window().title
    return _unless(operator, bool(running), f"{running} is running: wait for it, or press Esc over the window")


def _unless(operator: Any, hindered: bool, sentence: str) -> bool:
    if hindered:
        operator.poll_message_set(sentence)
    return not hindered
