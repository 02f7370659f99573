# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine steps in a worker thread while a caller waits."""

import threading
import time
from collections.abc import Callable

import numba
import numpy as np
import pytest

from patchnet.patchnet_addon.runtime import kernels  # noqa: F401 - it hears of compilations
from patchnet.patchnet_addon.runtime.compiling import NOTE, is_compiling
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import Progress, Result, Steps, drain
from patchnet.patchnet_addon.runtime.worker import attended, computed, run_in_worker

_LONG_S = 30.0  # never waited for


def attended_drain(steps: Steps[Result], on_report: Callable[[Progress], None] = lambda _: None) -> Result:
    """Pull them as a waiting caller does."""
    try:
        while True:
            with attended():
                report = next(steps)
            on_report(report)
    except StopIteration as stop:
        return stop.value
    finally:
        steps.close()


class Slow:
    """Steps that go on when they are allowed to, and tell where they were."""

    def __init__(self) -> None:
        self.go, self.began, self.closed = threading.Event(), threading.Event(), threading.Event()
        self.thread: threading.Thread | None = None

    def steps(self) -> Steps[int]:
        self.thread = threading.current_thread()
        try:
            yield Progress(1, 3, "First")
            self.began.set()
            assert self.go.wait(_LONG_S)
            yield Progress(2, 3, "Second")
            return 5
        finally:
            self.closed.set()


def test_who_waits_is_asked_while_a_step_takes_long() -> None:
    slow, reports = Slow(), []

    def see(report: Progress) -> None:
        reports.append(report)
        if slow.began.is_set() and len(reports) > 20:
            slow.go.set()

    assert attended_drain(run_in_worker(slow.steps, Progress(0, 1, "Start")), see) == 5
    assert len(reports) > 20
    assert all(report.waiting for report in reports)
    assert {report.label for report in reports} <= {"Start", "First", "Second"}
    assert slow.thread is not threading.main_thread()


def test_stopping_does_not_wait_for_the_step() -> None:
    slow = Slow()
    steps = run_in_worker(slow.steps, Progress(0, 1, "Start"))
    with attended():
        while not slow.began.is_set():
            next(steps)
    steps.close()
    assert not slow.closed.is_set()
    slow.go.set()
    assert slow.closed.wait(_LONG_S)  # and takes no more of them


@pytest.mark.parametrize("pull", [drain, attended_drain])
def test_errors_arrive(pull: Callable[[Steps[None]], None]) -> None:
    def steps() -> Steps[None]:
        yield Progress(0, 1, "Start")
        raise SettingError("Depth 99 is too deep")

    with pytest.raises(SettingError, match="Depth 99"):
        pull(run_in_worker(steps, Progress(0, 1, "Start")))


def test_reports_say_that_kernels_are_compiled() -> None:
    @numba.njit
    def count(values: np.ndarray) -> int:
        found = 0
        for value in values:
            found += value > 0.5
        return found

    for noted in (True, False):  # the second time it is there
        reports: list[Progress] = []
        steps = computed(lambda: (time.sleep(0.05), count(np.ones(3))), Progress(0, 1, "Counting"))
        attended_drain(steps, reports.append)
        assert any(report.note == NOTE for report in reports) == noted
        assert {report.label for report in reports} == {"Counting"}
    assert not is_compiling()
