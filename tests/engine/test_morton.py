# SPDX-License-Identifier: GPL-3.0-or-later
"""Morton keys against their definition, in NumPy and compiled."""

import numpy as np
import pytest

from patchnet.patchnet_addon.cells.morton import morton_decode_square, morton_encode
from patchnet.patchnet_addon.cells.morton_kernels import cell_coordinate, cell_key
from patchnet.patchnet_addon.runtime.kernels import kernel


@kernel
def _there_and_back(cells, keys, back):
    for row in range(len(cells)):
        keys[row] = cell_key(cells[row, 0], cells[row, 1], cells[row, 2])
        for axis in range(3):
            back[row, axis] = cell_coordinate(keys[row], axis)


def plain_key(cell):
    return sum((axis >> bit & 1) << (3 * bit + place) for bit in range(21) for place, axis in enumerate(cell))


@pytest.fixture
def cells():
    random = np.random.default_rng(0).integers(0, 1 << 21, (500, 3))
    return np.concatenate([random, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [2**21 - 1] * 3]])


def test_keys_have_the_bits_in_turn(cells):
    keys = morton_encode(cells)
    assert keys.dtype == np.uint64
    assert keys.tolist() == [plain_key(cell) for cell in cells.tolist()]
    assert keys[-6:].tolist() == [0, 1, 2, 4, 8, 2**63 - 1]


@pytest.mark.parametrize("count", [0, 1, 506])
@pytest.mark.parametrize("dtype", [np.int32, np.int64])
def test_kernels_have_the_same_keys(cells, count, dtype):
    cells = cells[:count].astype(dtype)
    keys, back = np.zeros(count, np.uint64), np.zeros((count, 3), np.int64)
    _there_and_back(cells, keys, back)
    np.testing.assert_array_equal(keys, morton_encode(cells))
    np.testing.assert_array_equal(back, cells)


def test_places_along_the_curve_of_a_square():
    places = np.concatenate([np.arange(64), np.random.default_rng(1).integers(0, 1 << 32, 200)])
    x, y = morton_decode_square(places)
    wanted = [
        [sum((place >> (2 * bit + axis) & 1) << bit for bit in range(16)) for place in places.tolist()]
        for axis in (0, 1)
    ]
    np.testing.assert_array_equal([x, y], wanted)
