# SPDX-License-Identifier: GPL-3.0-or-later
"""Parallel loops over parts of a range."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime import threads
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.patchnet_addon.runtime.threads import limit_threads, run_parts, thread_count


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


def test_parts_are_given_to_several_threads():
    """Four parts wait for one another, which only four threads can do."""
    together = threading.Barrier(4, timeout=30)
    used = set()

    def part(_first, _last):
        if len(used) < 4:
            together.wait()
            used.add(threading.get_ident())

    with ThreadPoolExecutor(3) as pool, pytest.MonkeyPatch.context() as patch:
        patch.setattr(threads, "_shared_pool", lambda: pool)
        run_parts(part, 4)
    assert len(used) == 4


def test_limits_are_taken_back():
    assert thread_count() == 4
    with limit_threads(2):
        assert thread_count() == 2
        with limit_threads(9):
            assert thread_count() == 4
        assert thread_count() == 2
    assert thread_count() == 4


def test_no_part_begins_after_an_error():
    begun = []

    def part(first, _last):
        begun.append(first)
        raise RuntimeError(f"part {first}")

    with pytest.raises(RuntimeError, match="part"):
        run_parts(part, 1000)
    assert len(begun) <= 4


def test_loops_in_several_threads_at_once():
    counts = np.zeros((8, 10_000), np.int64)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda row: run_parts(add_one, len(row), row), counts))
    np.testing.assert_array_equal(counts, 1)
