# SPDX-License-Identifier: GPL-3.0-or-later
"""Worker thread for engine steps, so that a waiting caller (a window, or Ctrl-C) stays responsive and can stop them.

A single step can take long: kernels compile at their first call, for up to half a minute in total, and a kernel over a
large octree computes for seconds. Python handles no event in that thread meanwhile. Where a caller waits, the work runs
in a second thread that reports its progress.

Stopped work is abandoned: it ends after its present step, and its result is discarded. So only steps that use neither
Blender nor files may run in a worker.
"""

from __future__ import annotations

import atexit
import contextvars
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Generic

from .compiling import NOTE, is_compiling
from .progress import Progress, Result, Steps

_LOOK_S = 0.01  # between two polls of the thread; a window is drawn between them
_STACK_BYTES = 16 << 20  # compilers recurse; some platforms' default is half a mebibyte
_PATIENCE_S = 2.0  # longest wait for a running kernel when the process ends

_attended: contextvars.ContextVar[bool] = contextvars.ContextVar("_attended", default=False)
_let_go: list[threading.Thread] = []


@contextmanager
def attended() -> Iterator[None]:
    """Mark that a caller waits for the steps pulled within the block, and needs frequent reports."""
    token = _attended.set(True)
    try:
        yield
    finally:
        _attended.reset(token)


def run_in_worker(make: Callable[[], Steps[Result]], at: Progress) -> Steps[Result]:
    """Run the steps of `make()` with the same reports, result and errors, in a thread if a caller waits.

    make: is called in that thread. at: report until the steps yield their first.
    """
    if not _attended.get():
        return (yield from make())
    work = _Work(make, replace(at, waiting=True))
    try:
        while not work.ended.wait(_LOOK_S):
            yield replace(work.report, note=NOTE) if is_compiling() else work.report
    finally:
        work.let_go()
    return work.result()


def computed(function: Callable[[], Result], at: Progress) -> Steps[Result]:
    """Return function(), computed in a thread if a caller waits; every report is `at`."""

    def steps() -> Steps[Result]:
        yield at
        return function()

    return run_in_worker(steps, at)


class _Work(Generic[Result]):
    """Steps in a thread; `report` is the latest, `ended` is set after the last."""

    def __init__(self, make: Callable[[], Steps[Result]], report: Progress) -> None:
        self.report = report
        self.ended = threading.Event()
        self._make: Callable[[], Steps[Result]] | None = make
        self._stop = False
        self._results: list[Result] = []
        self._error: BaseException | None = None
        context = contextvars.copy_context()
        before = threading.stack_size(_STACK_BYTES)
        try:
            self._thread = threading.Thread(target=context.run, args=(self._run,), name="PatchNet", daemon=True)
            self._thread.start()
        finally:
            threading.stack_size(before)

    def let_go(self) -> None:
        """Stop after the present step and discard its result."""
        self._stop = True
        if not self.ended.is_set():
            _let_go[:] = [thread for thread in _let_go if thread.is_alive()] + [self._thread]

    def result(self) -> Result:
        """Return the result of the steps, or raise their error; once, so that no memory is held."""
        if self._error is not None:
            raise self._error
        return self._results.pop()

    def _run(self) -> None:
        _attended.set(False)  # in this thread's copy of the context
        assert self._make is not None
        try:
            steps, self._make = self._make(), None
            try:
                while not self._stop:
                    self.report = replace(next(steps), waiting=True)
            except StopIteration as stop:
                self._results.append(stop.value)
            finally:
                steps.close()
        except BaseException as error:  # noqa: BLE001 - the caller that waits raises it
            self._error = error
        finally:
            self.ended.set()


@atexit.register
def _wait_for_kernels() -> None:
    """Wait for running kernels: a process that ends while one runs may crash."""
    deadline = time.monotonic() + _PATIENCE_S
    for thread in _let_go:
        thread.join(max(0.0, deadline - time.monotonic()))
