# SPDX-License-Identifier: GPL-3.0-or-later
"""The modal part of job operators, with a stand-in for the window that background mode lacks."""

import time
from types import SimpleNamespace

import bpy
import pytest

from patchnet.operators.jobs import job_operator
from patchnet.operators.jobs.job_operator import JobOperator, job_in_window
from patchnet.patchnet_addon.process.computed import (
    answer,
    computed,
    engine_pid,
    leave_engine_process,
    use_engine_process,
)
from patchnet.patchnet_addon.runtime.progress import Progress
from patchnet.tests.engine.process_work import asleep

pytestmark = pytest.mark.usefixtures("registered")


class Window:
    """Remembers what an operator did to the window manager and to the status bar."""

    def __init__(self) -> None:
        self.scene, self.view_layer = bpy.context.scene, bpy.context.view_layer
        self.timers: list[str] = []
        self.texts: list[str | None] = []
        self.window = self.screen = self
        self.areas: list[object] = []
        self.workspace = SimpleNamespace(status_text_set=self.texts.append)
        self.window_manager = SimpleNamespace(
            event_timer_add=lambda step, window: self.timers.append("timer") or "timer",
            event_timer_remove=self.timers.remove,
            modal_handler_add=lambda operator: None,
        )


class Counting(JobOperator):
    """Counts to a number, or fails on the way; `closed` is set by its cleaning up."""

    bl_label = "Count"

    def __init__(self, count: int, error: Exception | None = None) -> None:
        self.count, self.error, self.closed = count, error, False
        self.reports: list[tuple[set[str], str]] = []

    def report(self, kind: set[str], text: str) -> None:
        self.reports.append((kind, text))

    def steps(self, context, settings):
        try:
            for index in range(self.count):
                yield Progress(index, self.count, "Counting")
            if self.error:
                raise self.error
            return f"{self.count} steps"
        finally:
            self.closed = True


class Sleeping(Counting):
    """One step of the engine process, which takes `seconds`."""

    def __init__(self, seconds: float) -> None:
        super().__init__(0)
        self.seconds = seconds

    def steps(self, context, settings):
        try:
            return (yield from computed(asleep, self.seconds, at=Progress(0, 1, "Sleeping")))
        finally:
            self.closed = True


@pytest.fixture(autouse=True)
def in_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    monkeypatch.setattr(job_operator, "job_settings", lambda context, operator: None)
    monkeypatch.setattr(job_operator, "apply_preferences", lambda context: None)
    monkeypatch.setattr(job_operator, "passes", lambda context, event: event.type.startswith("WHEEL"))
    app = SimpleNamespace(background=False)
    monkeypatch.setattr(job_operator, "bpy", SimpleNamespace(app=app, types=bpy.types, data=bpy.data))


def event(kind: str) -> SimpleNamespace:
    return SimpleNamespace(type=kind, value="PRESS")


def test_runs_to_the_end_in_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_operator, "SLICE_S", 1e-9)
    window, operator = Window(), Counting(5)
    assert operator.invoke(window, event("LEFTMOUSE")) == {"RUNNING_MODAL"}
    assert job_in_window().title == "Count" and window.timers == ["timer"]
    states = [operator.modal(window, event("TIMER")) for _ in range(6)]
    assert states == [{"RUNNING_MODAL"}] * 5 + [{"FINISHED"}]
    assert operator.reports == [({"INFO"}, "5 steps")] and operator.closed
    assert window.texts[0] == "PatchNet: Counting 0 of 5   (Esc stops)" and window.texts[-1] is None
    assert job_in_window().title == "" and window.timers == []


class Known(Counting):
    """Steps whose own shares fall, in a job of which the whole is known but at its begin and its end."""

    _goes_on = True

    def steps(self, context, settings):
        shares = ("A", 0.9, None), ("B", 0.0, 0.1), ("B", 0.8, 0.4), ("C", 0.1, 0.35), ("D", 0, None)
        for label, done, whole in shares:
            yield Progress(done, 1, label, whole=whole)
        return ""


def test_there_is_one_percentage_which_never_falls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_operator, "SLICE_S", 1e-9)
    window, operator, shares = Window(), Known(0), []
    operator.invoke(window, event("LEFTMOUSE"))
    while operator.modal(window, event("TIMER")) == {"RUNNING_MODAL"}:
        shares.append(job_in_window().display.whole or 0.0)
    assert shares == [0.0, 0.1, 0.4, 0.4, 0.4]
    assert [text.removeprefix("PatchNet: ").split("   ")[0] for text in window.texts[:-1]] == [
        "A", "B 10 %", "B 40 %", "C 40 %", "D 40 %",
    ]  # fmt: skip


def test_window_lives_during_a_long_step_and_escape_acts_in_it() -> None:
    use_engine_process()
    try:
        answer(len, [])
        pid, window, operator = engine_pid(), Window(), Sleeping(60.0)
        operator.invoke(window, event("LEFTMOUSE"))
        states = [operator.modal(window, event("TIMER")) for _ in range(20)]
        assert states == [{"RUNNING_MODAL"}] * 20
        assert window.texts == ["PatchNet: Sleeping   (Esc stops)"]
        begun = time.monotonic()
        assert operator.modal(window, event("ESC")) == {"CANCELLED"}
        assert time.monotonic() - begun < 2.0, "0.2 s, beside other processes"
        assert pid is not None and engine_pid() is None, "the step would have taken long"
        assert operator.closed and job_in_window().title == ""
        assert [text for _kind, text in operator.reports] == ["Count was stopped: nothing was changed"]
        again = Sleeping(0.05)
        again.invoke(window, event("LEFTMOUSE"))
        while (state := again.modal(window, event("TIMER"))) == {"RUNNING_MODAL"}:
            pass
        assert state == {"FINISHED"} and again.reports == [({"INFO"}, "awake")]
    finally:
        leave_engine_process()


def test_unexpected_errors_are_raised_and_leave_no_timer() -> None:
    window, operator = Window(), Counting(2, ZeroDivisionError())
    operator.invoke(window, event("LEFTMOUSE"))
    with pytest.raises(ZeroDivisionError):
        operator.modal(window, event("TIMER"))
    assert operator.closed and job_in_window().title == "" and window.timers == []
