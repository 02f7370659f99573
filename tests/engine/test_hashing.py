# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes and tables of keys."""

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.hashing import fill_slots, mixed, row_of_key, slots_for
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.tests.references.surfels import mixed_reference


@kernel
def find_rows(slots, keys, wanted, found):
    for i in range(len(wanted)):
        found[i] = row_of_key(slots, keys, wanted[i])


@kernel
def mix(values, others, out):
    for i in range(len(values)):
        out[i] = mixed(values[i], others[i])


@pytest.mark.parametrize("low_bits", [0, 20, 44])
@pytest.mark.parametrize("count", [0, 1, 2, 1000])
def test_tables_find_their_keys_and_no_others(count: int, low_bits: int) -> None:
    """Keys with equal low bits, and with equal high bits."""
    keys = (np.arange(1, 2 * count + 1, dtype=np.uint64) << np.uint64(low_bits)) + np.uint64(5)
    keys = np.random.default_rng(count).permutation(keys)
    slots = slots_for(count)
    assert len(slots) >= 2 * count and len(slots) & (len(slots) - 1) == 0
    fill_slots(slots, keys, np.arange(count))
    found = np.zeros(2 * count, np.int64)
    find_rows(slots, keys[:count], keys, found)
    np.testing.assert_array_equal(found[:count], np.arange(count))
    assert (found[count:] < 0).all() and not slots[-1 - found[count:]].any()
    assert (slots > 0).sum() == count


def test_hashes_are_those_of_integers() -> None:
    rng = np.random.default_rng(1)
    values, others = rng.integers(0, 2**64, (2, 100), np.uint64)
    out = np.empty(100, np.uint64)
    mix(values, others, out)
    assert out.tolist() == [mixed_reference(int(a), int(b)) for a, b in zip(values, others, strict=True)]
    mix(values, np.full(100, -1, np.int64), out)  # of triangles without a sheet
    assert out.tolist() == [mixed_reference(int(a), -1) for a in values]


def test_small_integers_have_hashes_of_their_own() -> None:
    """Such as levels of a cell and faces: 0, 3 and 1, 2 have the same XOR."""
    values, others = (axis.ravel().astype(np.uint64) for axis in np.mgrid[:512, :32])
    out = np.empty(len(values), np.uint64)
    mix(values, others, out)
    assert len(np.unique(out)) == len(out)
