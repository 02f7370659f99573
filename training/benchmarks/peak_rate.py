# SPDX-License-Identifier: GPL-3.0-or-later
"""Most multiplications and additions of float32 that cores do in a second, where nothing is read or written."""

from __future__ import annotations

import time

import numpy as np

from ...patchnet_addon.network.lanes import WIDE_LANES, add_product, spread_wide
from ...patchnet_addon.runtime.kernels import kernel
from ...patchnet_addon.runtime.vectors import store

_ROUNDS = 500_000
_SUMS = 6  # more than a product takes until the next may be added, and as many as stay in registers


def measure_peak(threads: int, repeats: int = 50) -> float:
    """10^9 operations per second of as many cores as threads: the best run of one, times their number."""
    factors = np.linspace(0.25, 0.75, _SUMS, dtype=np.float32)  # distinct: equal sums would be made once
    results = np.empty(_SUMS * WIDE_LANES, np.float32)
    seconds = []
    for _ in range(repeats + 1):  # the first one compiles
        start = time.thread_time()
        _multiply_and_add(factors, results, _ROUNDS)
        seconds.append(time.thread_time() - start)
    return threads * _ROUNDS * _SUMS * WIDE_LANES * 2 / min(seconds) / 1e9


@kernel
def _multiply_and_add(factors, results, rounds):  # type: ignore[no-untyped-def]
    half = spread_wide(factors, 3)
    sum0, sum1, sum2 = spread_wide(factors, 0), spread_wide(factors, 1), spread_wide(factors, 2)
    sum3, sum4, sum5 = half, spread_wide(factors, 4), spread_wide(factors, 5)
    for _ in range(rounds):
        sum0, sum1, sum2 = add_product(half, half, sum0), add_product(half, half, sum1), add_product(half, half, sum2)
        sum3, sum4, sum5 = add_product(half, half, sum3), add_product(half, half, sum4), add_product(half, half, sum5)
    for index, total in enumerate((sum0, sum1, sum2, sum3, sum4, sum5)):
        store(results, index * WIDE_LANES, total)
