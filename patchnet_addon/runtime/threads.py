# SPDX-License-Identifier: GPL-3.0-or-later
"""Parallel loops: a kernel over parts of a range, in one thread per core.

Kernels run without the interpreter's lock, so that Python threads suffice. A thread takes the next part when it has
finished one, since parts of a picture differ in cost: rays into the sky end at once. Several threads may start loops at
the same time. numba's own parallel loops (`prange`) make compilation a third slower, divide the range in advance, and
crash the process when two of them start at the same time.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from typing import Any, Concatenate, ParamSpec

Arguments = ParamSpec("Arguments")

_PARTS = 8  # per thread: threads then end at nearly the same time
_limit: int | None = None


def usable_cores() -> int:
    """Number of cores available to this thread."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    """Number of threads of `run_parts`: one per usable core, unless limited by `limit_threads`."""
    return min(usable_cores(), _limit or usable_cores())


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max((os.cpu_count() or 1) - 1, 1), "PatchNet loop")  # threads start when they are needed


class _InPlace(Executor):
    """Executor that computes each task at once, in the thread that submits it."""

    def submit(self, task: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """Compute a task; its error is raised by the result."""
        future: Future[Any] = Future()
        try:
            future.set_result(task(*arguments, **named))
        except Exception as error:  # noqa: BLE001 - whoever asks for the result raises it
            future.set_exception(error)
        return future


def executor(threads: int) -> Executor:
    """Executor of some threads, or of none where loops are limited to one."""
    return _InPlace() if _limit == 1 else ThreadPoolExecutor(threads)


def use_no_threads() -> None:
    """Compute in the calling thread alone from now on."""
    global _limit
    _limit = 1


@contextmanager
def limit_threads(count: int | None) -> Iterator[None]:
    """Limit loops of the whole process to `count` threads within the block; None sets no limit."""
    global _limit
    before, _limit = _limit, count
    try:
        yield
    finally:
        _limit = before


def run_parts(
    kernel: Callable[Concatenate[int, int, Arguments], None],
    count: int,
    *arguments: Arguments.args,
    **named: Arguments.kwargs,
) -> None:
    """Call kernel(first, last, *arguments) for parts that make up range(count), on all cores.

    Parts are disjoint, of any order and size: their results must not depend on each other. Returns, or raises a part's
    error, when no part is running.
    """
    threads = min(thread_count(), count)
    if threads <= 1:
        if count:
            kernel(0, count, *arguments, **named)
        return
    size = -(-count // (_PARTS * threads))
    left = iter(range(0, count, size))  # shared by threads: `next` is atomic under the interpreter's lock

    def work() -> None:
        for first in left:
            kernel(first, min(first + size, count), *arguments, **named)

    helpers = [_pool().submit(work) for _ in range(threads - 1)]
    try:
        work()
    finally:
        for _ in left:  # after an error or Ctrl-C no thread begins another part
            pass
        wait(helpers)  # not cancelled: no thread runs Python later, while this one calls Blender
        for helper in helpers:
            helper.result()
