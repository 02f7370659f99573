# SPDX-License-Identifier: GPL-3.0-or-later
"""Vectors in kernels against NumPy, lane by lane."""

import numpy as np
import pytest

from patchnet.patchnet_addon.runtime.bits import count_ones, lowest_one
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.patchnet_addon.runtime.vectors import (
    LANES,
    larger,
    largest,
    less,
    load,
    select,
    smaller,
    smallest,
    splat,
    square_root,
    store,
    words_set,
)  # fmt: skip

NAMES = ("sum", "difference", "product", "quotient", "smaller", "larger", "root", "chosen", "shifted", "folded")


@kernel
def everything(left, right, mask, out):
    a, b = load(left, 0), load(right, 0)
    results = (
        a + b, a - b, a * b, a / b, smaller(a, b), larger(a, b), square_root(larger(a, splat(left.dtype.type(0)))),
        select(mask, a, b), load(left, 3), splat(smallest(a)) + splat(largest(b)),
    )  # fmt: skip
    for row in range(len(results)):
        store(out, row * LANES, results[row])
    return less(a, b)


@kernel
def bits(values, out):
    for row in range(len(values)):
        out[row, 0] = lowest_one(values[row])
        out[row, 1] = count_ones(values[row])


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_arithmetic(kind):
    rng = np.random.default_rng(0)
    left, right = rng.normal(size=(2, LANES + 3)).astype(kind)
    right[2] = left[2]
    out = np.empty((len(NAMES), LANES), kind)
    mask = 0b1010_0110_0000_1111
    met = everything(left, right, mask, out)
    a, b, chosen = left[:LANES], right[:LANES], (mask >> np.arange(LANES)) & 1 == 1
    expected = [
        a + b, a - b, a * b, a / b, np.minimum(a, b), np.maximum(a, b), np.sqrt(np.maximum(a, 0)),
        np.where(chosen, a, b), left[3 : LANES + 3], np.full(LANES, a.min() + b.max(), kind),
    ]  # fmt: skip
    for name, found, wanted in zip(NAMES, out, expected, strict=True):
        np.testing.assert_array_equal(found, wanted, err_msg=name)
    np.testing.assert_array_equal((met >> np.arange(LANES)) & 1 == 1, a < b)


@pytest.mark.parametrize("kind", [np.int64, np.uint64])
def test_bits(kind):
    values = np.array([1, 2, 3, 0xF0, 1 << 62, -1, 0], np.int64).astype(kind)
    out = np.empty((len(values), 2), np.int64)
    bits(values, out)
    np.testing.assert_array_equal(out, [[0, 1], [1, 1], [0, 2], [4, 4], [62, 1], [0, 64], [64, 0]])


@kernel
def words_there(words):
    return words_set(words, 1)


def test_words_there() -> None:
    words = np.array([1, -1, 0, 5, -7, 0, 2**31 - 1, -(2**31), 3, 9])
    found = words_there(words.astype(np.uint32))
    assert [found >> lane & 1 for lane in range(8)] == (words != 0)[1:9].tolist() and found < 256
