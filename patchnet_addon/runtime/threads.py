# SPDX-License-Identifier: GPL-3.0-or-later
"""Parallel loops: a kernel over parts of a range, in as many threads as there are cores.

Kernels run without the interpreter's lock, so that plain threads are enough. Threads take the next part when they have
done one, since parts of a picture differ: rays of the sky end at once. Loops may be started in several threads at once.
With numba's own parallel loops (`prange`) all kernels compile a third longer; they divide evenly beforehand, and end
the process when two of them are started at once.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from typing import Any

_PARTS = 8  # of each thread: the last ones end nearly together
_limit: int | None = None


def usable_cores() -> int:
    """Cores that this thread may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    """Threads that `run_parts` uses: one for each usable core, unless `limit_threads` says fewer."""
    return min(usable_cores(), _limit or usable_cores())


@contextmanager
def limit_threads(count: int | None) -> Iterator[None]:
    """Use at most `count` threads for the loops within the block, in the whole process; None does not limit them."""
    global _limit
    before, _limit = _limit, count
    try:
        yield
    finally:
        _limit = before


def run_parts(kernel: Callable[..., Any], count: int, *arguments: Any) -> None:
    """Call kernel(first, last, *arguments) for parts that make up range(count), on all cores.

    Parts are disjoint and nothing is said of their order or size: what a part computes must not depend on others.
    Returns, or raises what a part raised, when no part is running any more.
    """
    threads = min(thread_count(), count)
    if threads <= 1:
        if count:
            kernel(0, count, *arguments)
        return
    size = -(-count // (_PARTS * threads))
    left = iter(range(0, count, size))  # threads share it: `next` is one step under the interpreter's lock

    def work() -> None:
        for first in left:
            kernel(first, min(first + size, count), *arguments)

    helpers = [_pool().submit(work) for _ in range(threads - 1)]
    try:
        work()
    finally:
        for _ in left:  # after an error or Ctrl-C, nobody begins another part
            pass
        running = [helper for helper in helpers if not helper.cancel()]  # those that did not begin are not needed
        wait(running)
        for helper in running:
            helper.result()


_making = threading.Lock()


def _pool() -> ThreadPoolExecutor:
    with _making:
        return _shared_pool()


@cache
def _shared_pool() -> ThreadPoolExecutor:
    """Threads beside the one that calls; loops of several callers share them."""
    return ThreadPoolExecutor(max((os.cpu_count() or 1) - 1, 1), "PatchNet loop")
