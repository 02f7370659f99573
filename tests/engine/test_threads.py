# SPDX-License-Identifier: GPL-3.0-or-later
"""Parallel loops over parts of a range."""

import threading

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime import threads
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.patchnet_addon.runtime.threads import executor, limit_threads, run_parts


@pytest.fixture(autouse=True)
def four_cores(monkeypatch):
    monkeypatch.setattr(threads, "usable_cores", lambda: 4)


@kernel
def add_one(first, last, counts):
    for index in range(first, last):
        counts[index] += 1


@pytest.mark.parametrize("count", [0, 1, 3, 32, 33, 5000])
@pytest.mark.parametrize("limit", [None, 1, 2])
def test_each_index_is_in_one_part(count, limit):
    counts = np.zeros(count, np.int64)
    with limit_threads(limit):
        run_parts(add_one, count, counts)
    np.testing.assert_array_equal(counts, 1)


def test_no_part_begins_after_an_error():
    begun = []

    def part(first, _last):
        begun.append(first)
        raise RuntimeError(f"part {first}")

    with pytest.raises(RuntimeError, match="part"):
        run_parts(part, 1000)
    assert len(begun) <= 4


@pytest.mark.parametrize(("limit", "is_here"), [(1, True), (None, False)])
def test_tasks_of_one_thread_run_in_the_one_that_submits_them(limit, is_here):
    here = threading.get_ident()
    with limit_threads(limit), executor(3) as pool:
        idents = [pool.submit(threading.get_ident).result(), *pool.map(lambda _: threading.get_ident(), range(3))]
        failed = pool.submit(int, "one")
    assert {ident == here for ident in idents} == {is_here}
    with pytest.raises(ValueError, match="one"):
        failed.result()
