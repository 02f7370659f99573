# SPDX-License-Identifier: GPL-3.0-or-later
"""Our matrix product against NumPy's, and that a row's bits depend on nothing but the row and the matrix."""

import numpy as np
import pytest

from patchnet.patchnet_addon.network.compiled_encode import similar_order
from patchnet.patchnet_addon.network.encode import sum_octants
from patchnet.patchnet_addon.network.product import ROWS, WIDTH, Panels, multiply
from patchnet.patchnet_addon.runtime.threads import limit_threads
from patchnet.tests.references.small import multiply_reference, sum_octants_reference

ROUNDING = 2.0**-24  # of float32, relative


def samples(rows, depth, columns, zeros=0.0, seed=0):
    """Values (rows, depth), the share `zeros` of them 0, a matrix (depth, columns) and a bias (columns,)."""
    random = np.random.default_rng(seed)
    values = random.standard_normal((rows, depth), dtype=np.float32)
    values[random.random(values.shape) < zeros] = 0
    matrix = random.standard_normal((depth, columns), dtype=np.float32)
    return values, matrix, random.standard_normal(columns, dtype=np.float32)


def product(values, matrix, bias=None, **how):
    panels = Panels.pack(matrix, bias)
    result = np.full((len(values), panels.width), np.nan, np.float32)
    multiply(values, panels, result, **how)
    assert panels.columns == matrix.shape[1] and (result[:, panels.columns :] == 0).all()
    return result[:, : panels.columns]


@pytest.mark.parametrize("rows", [0, 1, ROWS - 1, ROWS, ROWS + 1, 37, 8 * ROWS + 1, 1000])
@pytest.mark.parametrize(
    ("depth", "columns"), [(1, 1), (7, 10), (256, 10), (33, WIDTH), (64, WIDTH + 1), (256, 256), (320, 2048)]
)
@pytest.mark.parametrize("zeros", [0.0, 0.7])
def test_product_is_numpys(rows, depth, columns, zeros):
    """Within twice the bound of a sum's rounding: the order of additions differs."""
    values, matrix, bias = samples(rows, depth, columns, zeros)
    bound = 2 * (depth + 1) * ROUNDING * (np.abs(values) @ np.abs(matrix) + np.abs(bias))
    for relu in (False, True):
        wanted = multiply_reference(values, matrix, bias, relu=relu)
        assert (np.abs(product(values, matrix, bias, relu=relu) - wanted) <= bound).all()
    assert (np.abs(product(values, matrix) - multiply_reference(values, matrix)) <= bound).all()


def test_a_row_has_the_same_bits_in_any_company_order_and_number_of_threads():
    values, matrix, bias = samples(203, 320, 256, zeros=0.6)
    whole = product(values, matrix, bias)
    for row in (0, 5, 101, 202):
        np.testing.assert_array_equal(product(values[row : row + 1], matrix, bias)[0], whole[row])
    order = np.random.default_rng(1).permutation(len(values))
    np.testing.assert_array_equal(product(values, matrix, bias, order=order), whole)
    with limit_threads(1):
        np.testing.assert_array_equal(product(values, matrix, bias), whole)


def test_zeros_of_either_sign_and_empty_rows():
    values, matrix, bias = samples(9, 40, 20, zeros=0.5)
    values[3] = 0
    result = product(values, matrix, bias)
    np.testing.assert_array_equal(result[3], bias)
    np.testing.assert_array_equal(product(np.where(values == 0, np.float32(-0.0), values), matrix, bias), result)


def test_what_is_not_finite_stays_so():
    values, matrix, bias = samples(6, 16, WIDTH)
    values[2, 4], values[4, 0] = np.nan, np.inf
    result = product(values, matrix, bias, relu=True)
    assert np.isnan(result[2]).all() and set(result[4]) == {0, np.inf}
    assert np.isfinite(result[[0, 1, 3, 5]]).all()


@pytest.mark.parametrize(
    "change",
    [
        lambda values, result: (values.astype(np.float64), result),
        lambda values, result: (np.asfortranarray(values), result),
        lambda values, result: (values[:, :-1], result),
        lambda values, result: (values, result[:-1]),
        lambda values, result: (values, result[:, ::2]),
    ],
)
def test_arrays_that_the_kernel_would_misread(change):
    values, matrix, _ = samples(5, 12, 2 * WIDTH)
    changed = change(values, np.empty((5, 2 * WIDTH), np.float32))
    with pytest.raises(ValueError, match="in C order is needed"):
        multiply(changed[0], Panels.pack(matrix), changed[1])


@pytest.mark.parametrize("corners", [0, 1, 333])
def test_sum_of_octants(corners):
    """Within rounding: eight numbers of about 1 and a bias are added in another order."""
    random = np.random.default_rng(2)
    products = random.standard_normal((50, 8 * 256), dtype=np.float32)
    products[0] = np.nan  # block 0 is empty and never read
    rows = np.where(random.random((corners, 8)) < 0.5, random.integers(1, 50, (corners, 8)), 0)
    bias = random.standard_normal(256, dtype=np.float32)
    values = np.empty((corners, 256), np.float32)
    sum_octants(0, len(rows), products, rows, bias, values)
    np.testing.assert_allclose(values, sum_octants_reference(products, rows, bias), atol=1e-5)


def test_blocks_with_the_same_cells_are_put_side_by_side():
    random = np.random.default_rng(3)
    kinds = random.random((6, 64)) < 0.4
    which = random.integers(0, 6, 100)
    blocks = np.zeros((100, 64, 5), np.float32)
    blocks[..., 0] = kinds[which]
    blocks[..., 1:] = random.standard_normal((100, 64, 4)) * blocks[..., :1]
    order = similar_order(blocks.reshape(100, 320))
    np.testing.assert_array_equal(np.sort(order), np.arange(100))
    assert np.count_nonzero(np.diff(which[order])) == len(np.unique(which)) - 1
